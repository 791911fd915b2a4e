/** Fields in Babylon.js's engine for WebGPU, in Firefox, against its engine for WebGL in Chromium. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before } from "node:test";
import type { Browser } from "playwright-core";
import { openFirefox, withoutFirefox } from "./firefox.js";
import type { BabylonLook } from "./others/asked.js";
import type { Told } from "./others/babylon.webgpu.js";
import { CountingServer, launch, newPage, night, openOther, psnr, ROOT } from "./support.js";

const SIZE = 64;
const server = new CountingServer();
let browser: Browser;
const skip = withoutFirefox() ?? false;

before(async () => {
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

night("Babylon.js draws fields with WebGPU as it does with WebGL, among meshes and of either hand", { skip }, async () => {
  const looks: BabylonLook[] = [];
  for (const [name, wall] of [["tiny.rate"], ["harmonics"], ["harmonics", 3.3], ["dvgo.coverage"], ["boxes"]] as [string, number?][]) {
    const address = server.offer(`${name}.mipvog`, readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
    const isWorld = name === "boxes";
    const look: Omit<BabylonLook, "rightHanded"> = { address, size: SIZE, position: isWorld ? [0.5, 0.3, 0.4] : [2.6, 1.4, 1.9], target: isWorld ? [-0.5, 0.2, 0] : [0, 0, 0], angle: isWorld ? 1.2 : 0.7, background: [1, 1, 1] };
    for (const rightHanded of [true, false]) looks.push({ ...look, rightHanded, ...(wall && { wall }) });
  }
  const { page, problems } = await newPage(browser);
  await openOther(page, server, "babylon.webgpu");
  const wanted: Told[] = [];
  for (const look of looks) wanted.push(await page.evaluate((look) => window.drawBoth(look, "webgl"), look));
  await page.close();
  assert.deepEqual(problems, []);
  server.offer("babylon.webgpu.js", readFileSync(join("build", "tests", "others", "babylon.webgpu.js")));
  server.offer("worker.js", readFileSync(join("build", "tests", "others", "worker.js")));
  server.offer("own.html", Buffer.from('<!doctype html><link rel="icon" href="data:,"><script type="module" src="babylon.webgpu.js"></script>'));
  const answer = server.told();
  const close = openFirefox(`${server.origin}/own.html?looks=${encodeURIComponent(JSON.stringify(looks))}`);
  const late = new Promise<never>((_, no) => setTimeout(() => no(new Error("Firefox told nothing")), 90_000).unref());
  const found = (await Promise.race([answer, late]).finally(close)) as Told[] | { error: string };
  if ("error" in found) assert.fail(found.error);
  found.forEach(({ pixels, rays, fetches, picked, refused }, number) => {
    const { address, rightHanded } = looks[number];
    const [name, told] = [`${address}, ${rightHanded}`, wanted[number]];
    assert.ok(pixels.some((value, at) => at % 4 < 3 && value < 250), name);
    // Where the field and the wall meet, the other rasterizer may see the other one: two pixels at most.
    const off = pixels.map((value, at) => (Math.abs(value - told.pixels[at]) > 8 ? at >> 2 : -1));
    const likeness = psnr(pixels, told.pixels);
    if (looks[number].wall) assert.ok(new Set(off).size <= 3, `${name}: ${likeness} dB`);
    else assert.ok(likeness >= 45, `${name}: ${likeness} dB`);
    // A ray along an edge of the box is one of it or not.
    assert.ok(Math.abs(rays - told.rays) <= 2, name);
    assert.ok(Math.abs(fetches - told.fetches) <= 0.02 * told.fetches, `${name}: ${fetches} fetches of ${told.fetches}`);
    assert.equal(picked === null, told.picked === null, name);
    picked?.forEach((value, axis) => assert.ok(Math.abs(value - told.picked![axis]) < 0.01, `${name}: ${picked} and ${told.picked}`));
    assert.match(refused, /answer later.*/);
  });
});
