/** Pictures against the reference renderer's. */

import assert from "node:assert/strict";
import { existsSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { bakedScene, capture, CountingServer, launch, newPage, night, pixels, program, psnr, ready, ROOT, temporaryFolder, turntable, views } from "./support.js";

const FIXTURES = join(ROOT, "fixtures");
const LEGO = join(FIXTURES, "trained", "lego64");
const folder = temporaryFolder();
const server = new CountingServer();
let browser: Browser;

before(async () => {
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

test("a trained scene looks as the reference renderer draws it, near and far", async () => {
  const { container, asset } = bakedScene("lego");
  const cameras = join(LEGO, "transforms_test.json");
  const reference = join(folder.path, "lego64");
  program("render", container, "--cameras", cameras, "--size", "200x200", "--frames", "0,1,2", "--scales", "1,4", "-o", reference);
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("lego64.mipvog", readFileSync(container)));
  await ready(page);
  const frames = JSON.parse(readFileSync(cameras, "utf8")).frames;
  for (const [i, view] of views(cameras, 200).slice(0, 3).entries()) {
    const name = frames[i].file_path.split("/").pop();
    for (const [scale, least] of [
      [1, 40],
      [4, 38],
    ]) {
      const small = { ...view, width: view.width / scale, height: view.height / scale, focal: view.focal / scale };
      const found = psnr(await capture(page, small), await pixels(page, join(reference, `${name}.s${scale}.png`)));
      assert.ok(found >= least, `${name} at 1/${scale}: ${found} dB`);
    }
  }
  // A march that skips reads a third of what a dense one does, at most, and sees the same.
  const [sparse, dense] = await page.evaluate(() => [window.__mipvog.statistics(true)!, window.__mipvog.statistics(false)!]);
  assert.equal(sparse.rays, dense.rays);
  assert.ok(sparse.rays > 1000, `${sparse.rays} rays`);
  assert.ok(3 * sparse.fetchesPerRay <= dense.fetchesPerRay, `${sparse.fetchesPerRay} of ${dense.fetchesPerRay}`);
  // The asset that `bake --gltf` writes shows the field, not its mesh.
  await page.goto(server.page("lego64.glb", readFileSync(asset)));
  await ready(page);
  const found = psnr(await capture(page, views(cameras, 200)[0]), await pixels(page, join(reference, "r_0.s1.png")));
  assert.ok(found >= 40, `the asset: ${found} dB`);
  assert.deepEqual(problems, []);
  await page.close();
});

const CONTAINERS = ["tiny.rate", "tiny.fit.filled", "tiny.code", "tiny.12bit", "tiny.rate.f16", "dvgo.f32", "dvgo.mask", "dvgo.coverage", "harmonics", "harmonics.filled", "harmonics.f16", "linear", "plenoxels_anisotropic", "tensorf_vm_relu_rgb", "snerg"];

/** A baked fixture, or what a bake makes of the model of this name; SNeRG's is made of a baked fixture. */
function containerOf(name: string): string {
  const baked = join(FIXTURES, "baked", `${name}.mipvog`);
  if (existsSync(baked)) return baked;
  const container = join(folder.path, `${name}.mipvog`);
  const model = name === "snerg" ? join(folder.path, name) : ["npz", "th"].map((ending) => join(FIXTURES, "grids", `${name}.${ending}`)).find(existsSync)!;
  if (name === "snerg") program("export", join(FIXTURES, "baked", "tiny.rate.mipvog"), "--to", "snerg", "-o", model);
  program("bake", model, "-o", container);
  return container;
}

night("a device of few uniforms reads the network's weights from a texture, and draws the same", async () => {
  const { page, problems } = await newPage(browser);
  const few = "{ const { prototype } = WebGL2RenderingContext, { getParameter } = prototype; prototype.getParameter = function (name) { return name === this.MAX_FRAGMENT_UNIFORM_VECTORS ? 224 : getParameter.call(this, name); }; }";
  await page.route("**/worker.js", async (route) => {
    const response = await route.fetch();
    await route.fulfill({ response, body: `${few}\n${await response.text()}` });
  });
  const container = join(FIXTURES, "baked", "tiny.rate.mipvog");
  const { bounds } = JSON.parse(program("inspect", container, "--format", "json"));
  program("render", container, "--turntable", "3", "--frames", "1", "--size", "64x64", "-o", join(folder.path, "few"));
  await page.goto(server.page("few.mipvog", readFileSync(container)));
  await ready(page);
  const uniforms = await page.evaluate(() => {
    const { renderer } = window.__mipvog.stage;
    const gl = renderer.getContext();
    return renderer.info.programs!.flatMap(({ program }) => ["u_weights", "u_network"].filter((name) => gl.getUniformLocation(program as WebGLProgram, name) !== null));
  });
  assert.deepEqual([...new Set(uniforms)], ["u_weights"]);
  const found = psnr(await capture(page, turntable(bounds, 3, 64)[1]), await pixels(page, join(folder.path, "few", "turn_001.s1.png")));
  assert.ok(found >= 50, `${found} dB`);
  assert.deepEqual(problems, []);
  await page.close();
});

/** One of each way to make colours; the others wait for the night. */
const FIRST = ["tiny.rate", "dvgo.coverage", "harmonics", "linear"];

for (const name of CONTAINERS) {
  (FIRST.includes(name) ? test : night)(`${name} looks as the reference renderer draws it, level by level`, async () => {
    const container = containerOf(name);
    const { bounds, levels } = JSON.parse(program("inspect", container, "--format", "json"));
    const { page, problems } = await newPage(browser);
    await page.goto(server.page(`${name}.mipvog`, readFileSync(container)));
    await ready(page);
    const [, view] = turntable(bounds, 3, 64);
    for (const level of ["auto", ...levels.keys()]) {
      const reference = join(folder.path, `${name}.${level}`);
      program("render", container, "--turntable", "3", "--frames", "1", "--size", "64x64", "--level-of-detail", String(level), "-o", reference);
      await page.evaluate((level) => (window.__mipvog.field!.fixedLevel = typeof level === "number" ? level : null), level);
      const found = psnr(await capture(page, view), await pixels(page, join(reference, "turn_001.s1.png")));
      // The lowest are 56.8 and 60.7 dB; without directional brightness tiny.fit.filled has 42, without anisotropy 44.
      assert.ok(found >= 55, `level ${level}: ${found} dB`);
    }
    assert.deepEqual(problems, []);
    await page.close();
  });
}
