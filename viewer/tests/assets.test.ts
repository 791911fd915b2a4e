/** Assets with compressed meshes and textures, and files that their addresses do not tell. */

import assert from "node:assert/strict";
import { after, before } from "node:test";
import type { Browser, Page } from "playwright-core";
import { container, plain, SQUARES, withDraco, withKtx2, withMeshopt } from "./compressed.js";
import { CountingServer, launch, newPage, night, ready } from "./support.js";

const server = new CountingServer();
/** The policy of `view`. */
const POLICY = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self' data: blob:";
let browser: Browser;

before(async () => {
  await server.start();
  server.headers = { "Content-Security-Policy": POLICY };
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

/** Of what the page shows of an asset: pixels, the triangles of its meshes, and fields. */
async function shown(page: Page, address: string): Promise<{ pixels: number[]; triangles: number; finest: number | null; error: string | null }> {
  await page.goto(`${server.origin}/?file=${encodeURIComponent(address)}`);
  await page.waitForFunction(() => window.__mipvog?.ready);
  return page.evaluate(() => {
    const { stage, field, error } = window.__mipvog;
    let triangles = 0;
    stage.scene.traverse((part) => {
      const { geometry, isMesh } = part as import("three").Mesh;
      if (isMesh && !("isRadianceField" in part)) triangles += (geometry.index?.count ?? 0) / 3;
    });
    return { pixels: Array.from(stage.capture(96, 96, [1, 0, 0, 0, 0, 0.8, -0.6, 0, 0, 0.6, 0.8, 0, 0, 3, 6, 1], 100)), triangles, finest: field?.finest ?? null, error };
  });
}

const green = (pixels: number[]) => pixels.filter((value, at) => at % 4 === 1 && value > 60 && pixels[at - 1] < 10 && pixels[at + 1] < 10).length;

night("assets that are compressed by Draco or meshoptimizer are shown as those that are not", async () => {
  const { page, problems } = await newPage(browser);
  const wanted = await shown(page, server.offer("plain.glb", plain()));
  assert.ok(green(wanted.pixels) > 500, `${green(wanted.pixels)} pixels of floor`);
  const compressed = { "draco.glb": await withDraco(), "ext.glb": await withMeshopt("EXT_meshopt_compression"), "khr.glb": await withMeshopt("KHR_meshopt_compression") };
  for (const [name, bytes] of Object.entries(compressed)) {
    const found = await shown(page, server.offer(name, bytes));
    assert.deepEqual([found.triangles, found.finest, found.error], [2 * SQUARES ** 2, 0, null], name);
    const furthest = found.pixels.reduce((most, value, at) => Math.max(most, Math.abs(value - wanted.pixels[at])), 0);
    // Draco rounds positions.
    assert.ok(furthest <= (name === "draco.glb" ? 80 : 0), `${name}: ${furthest}`);
    assert.ok(Math.abs(green(found.pixels) - green(wanted.pixels)) < 20, name);
  }
  assert.deepEqual(problems, []);
  await page.close();
});

night("a texture without a decoder is left out, and the page says which", async () => {
  const { page, problems } = await newPage(browser);
  const found = await shown(page, server.offer("ktx2.glb", withKtx2()));
  assert.deepEqual([found.triangles, found.finest], [2 * SQUARES ** 2, 0]);
  assert.ok(green(found.pixels) > 500);
  const card = page.locator("#error");
  assert.match(await card.innerText(), /shown without some of its parts[^]*Basis Universal \(KTX2 textures\)/);
  // It stands beside the picture.
  assert.equal(await page.evaluate(() => document.elementFromPoint(innerWidth / 2, innerHeight / 2)?.id), "picture");
  assert.deepEqual(problems, []);
  await page.close();
});

night("where decoders do not work, the field is shown alone, and the page says which it was", async () => {
  const draco = server.offer("draco.glb", await withDraco());
  const meshopt = server.offer("ext.glb", await withMeshopt("EXT_meshopt_compression"));
  server.headers = { "Content-Security-Policy": POLICY.replace(" 'wasm-unsafe-eval'", "") };
  for (const [address, name] of [[draco, "Draco"], [meshopt, "meshoptimizer"]]) {
    const { page } = await newPage(browser);
    const found = await shown(page, address);
    assert.deepEqual([found.triangles, found.finest], [0, 0]);
    assert.match(found.error!, new RegExp(`shown without its meshes, which ${name} could not decode`));
    await page.close();
  }
  server.headers = { "Content-Security-Policy": POLICY };
});

night("what an address without an ending leads to is told by its first bytes", async () => {
  const { page, problems } = await newPage(browser);
  for (const ranges of [true, false]) {
    server.ranges = ranges;
    for (const bytes of [plain(), container]) {
      server.offer("api", bytes);
      await page.goto(`${server.origin}/?file=api%3Fid%3D7`);
      await ready(page);
      assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), 0);
      const meshes = await page.evaluate(() => window.__mipvog.stage.scene.getObjectByName("floor") !== undefined);
      assert.equal(meshes, bytes !== container);
    }
  }
  server.ranges = true;
  assert.deepEqual(problems, []);
  await page.close();
});
