/** Every kind of field as three.js's WebGPURenderer draws it, against WebGL in the same browser. */

import assert from "node:assert/strict";
import { existsSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { CountingServer, launchWebGPU, newPage, night, openOther, program, psnr, ROOT, temporaryFolder } from "./support.js";
import { withMetadata } from "./metadata.js";
import type {} from "./others/floor.js";
import type {} from "./others/webgpu.js";

const FIXTURES = join(ROOT, "fixtures");
const folder = temporaryFolder();
const server = new CountingServer();
let browser: Browser;
let page: Page;
let problems: string[];

before(async () => {
  await server.start();
  browser = await launchWebGPU();
  ({ page, problems } = await newPage(browser));
  await openOther(page, server, "webgpu");
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

/** What went wrong since this was last asked. */
function wrong(): string[] {
  return problems.splice(0);
}

/** Replacements in the metadata of baked fixtures that give kinds of which there is none. */
const MADE: Record<string, [from: string, change: [string, string]]> = {
  "boxes.constant": ["boxes", ['"step_rule":"level_of_detail"', '"step_rule":"constant"']],
  "harmonics.unclamped": ["harmonics", ['"clamp":"zero"', '"clamp":"none"']],
  "tiny.density": ["tiny.rate", ['"order":"raw"', '"order":"density"']],
  "tiny.opacity": ["tiny.rate", ['"order":"raw"', '"order":"opacity"']],
};

const BAKED = ["tiny.rate", "tiny.fit.filled", "tiny.code", "tiny.isotropic", "dvgo.f16", "dvgo.coverage", "harmonics", "harmonics.filled", "harmonics.f16", "linear", "boxes", "boxes.deep"];

function containerOf(name: string): Uint8Array {
  const baked = (name: string) => join(FIXTURES, "baked", `${name}.mipvog`);
  if (name in MADE) return withMetadata(readFileSync(baked(MADE[name][0])), ...MADE[name][1]);
  if (existsSync(baked(name))) return readFileSync(baked(name));
  const container = join(folder.path, `${name}.mipvog`);
  program("bake", join(FIXTURES, "voxels", `${name}.pt`), "-o", container);
  return readFileSync(container);
}

/** One of each way to make colours, and a world; the others wait for the night. */
const FIRST = ["tiny.rate", "dvgo.coverage", "harmonics", "boxes"];

for (const name of [...BAKED, ...Object.keys(MADE), "svraster_geosvr"]) {
  (FIRST.includes(name) ? test : night)(`${name} looks in WebGPU as it does in WebGL`, async () => {
    const address = server.offer(`${name}.mipvog`, Buffer.from(containerOf(name)));
    const found = await page.evaluate(async (address) => {
      const { sceneOf, rendererOf, cameraAt, load, picture, targetOf } = window.gpu;
      // One field of both renderers.
      const { scene, field } = sceneOf(address);
      const [webgl, webgpu] = [await rendererOf("webgl"), await rendererOf("webgpu")];
      await field.opened;
      field.updateMatrixWorld();
      const box = field.visibleBounds.applyMatrix4(field.matrixWorld);
      const place = (shares: number[]) => box.min.toArray().map((min, axis) => min + (0.5 + 0.5 * shares[axis]) * (box.max.toArray()[axis] - min)) as [number, number, number];
      const looks = field.isWorld ? [[[-0.6, 0.2, 0.4], [1, 0, -0.2]], [[0.5, 0, 0.5], [-0.7, 0.2, -0.7]], [[0.9, 0.7, 0.9], [0, 0.1, 0.2]]] : [[[3.5, 1.4, 0.6], [0, 0, 0]], [[-1.2, 0.3, 1.1], [0, 0, 0]], [[0, -6, 2], [0, 0, 0]]];
      const cameras = looks.map(([from, to]) => cameraAt(place(from), place(to)));
      await load(webgl, scene, cameras[0].clone());
      // For a second device all of it comes again.
      webgpu.setRenderTarget(targetOf({}, 1));
      webgpu.render(scene, cameras[0].clone());
      const isAsked = field.decoding;
      await load(webgpu, scene, cameras[0].clone());
      const all = [];
      for (const camera of cameras) {
        for (const size of [72, 24, 9]) {
          // Renderers leave their own projection in a camera.
          const pair = [await picture(webgl, scene, camera.clone(), targetOf({}, size)), await picture(webgpu, scene, camera.clone(), targetOf({}, size))];
          all.push({ size, pair });
        }
      }
      const [camera] = cameras;
      const count = async (skips: boolean) => [await field.statisticsAsync(webgl, camera, 32, 32, 64, skips), await field.statisticsAsync(webgpu, camera, 32, 32, 64, skips)];
      const statistics = [await count(true), await count(false)];
      const picked = [];
      for (const renderer of [webgl, webgpu]) picked.push(await Promise.all([[0.5, 0.5], [0.55, 0.47], [0.001, 0.001]].map(async ([x, y]) => (await field.pickAsync(renderer, camera, x, y))?.toArray() ?? null)));
      const plain = await picture(webgl, scene, camera.clone());
      field.showLevels = true;
      const tinted = [await picture(webgl, scene, camera.clone()), await picture(webgpu, scene, camera.clone())];
      field.dispose();
      webgl.dispose();
      await webgpu.dispose();
      return { all, statistics, picked, plain, tinted, isAsked };
    }, address);
    assert.ok(found.isAsked);
    const drawn = ({ pixels }: { pixels: number[] }) => pixels.filter((value, at) => at % 4 < 3 && value < 250).length;
    for (const { size, pair: [webgl, webgpu] } of found.all) {
      assert.ok(drawn(webgl) > 0, `at ${size}`);
      const likeness = psnr(webgl.pixels, webgpu.pixels);
      const depth = Math.max(...webgl.depths.map((depth, pixel) => Math.abs(depth - webgpu.depths[pixel])));
      assert.ok(likeness >= 60 && depth <= 1e-4, `at ${size}: ${likeness} dB, depths ${depth} apart`);
    }
    // Fog, which dvgo is, has little of its tint.
    assert.ok(psnr(found.tinted[0].pixels, found.tinted[1].pixels) >= 60 && psnr(found.tinted[0].pixels, found.plain.pixels) < 50);
    for (const [webgl, webgpu] of found.statistics) {
      assert.equal(webgpu.rays, webgl.rays);
      for (const name of ["samplesPerRay", "fetchesPerRay", "stepsPerRay"] as const) assert.ok(Math.abs(webgpu[name] - webgl[name]) <= 0.01 * webgl[name], `${name}: ${webgpu[name]} of ${webgl[name]}`);
    }
    const [there, here] = found.picked;
    there.forEach((point, number) => {
      const other = here[number];
      assert.equal(other === null, point === null);
      if (point && other) assert.ok(Math.hypot(...point.map((value, axis) => value - other[axis])) < 1e-3, `${point} and ${other}`);
    });
    assert.deepEqual(wrong(), []);
  });
}

night("a device of few uniforms reads the network's weights from a texture in WebGPU, too", async () => {
  const { page: other, problems: trouble } = await newPage(browser);
  const few = "{ const { prototype } = WebGL2RenderingContext, { getParameter } = prototype; prototype.getParameter = function (name) { return name === this.MAX_FRAGMENT_UNIFORM_VECTORS ? 224 : getParameter.call(this, name); }; }";
  await other.route("**/worker.js", async (route) => {
    const response = await route.fetch();
    await route.fulfill({ response, body: `${few}\n${await response.text()}` });
  });
  await openOther(other, server, "webgpu");
  const address = server.offer("few.mipvog", readFileSync(join(FIXTURES, "baked", "tiny.rate.mipvog")));
  const { pictures: [webgl, webgpu], uniforms } = await other.evaluate(async (address) => {
    const { sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const { scene, field } = sceneOf(address);
    const pictures = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const renderer = await rendererOf(kind);
      await load(renderer, scene, cameraAt([3.5, 1.4, 0.6]));
      pictures.push((await picture(renderer, scene, cameraAt([3.5, 1.4, 0.6]))).pixels);
    }
    return { pictures, uniforms: field.file!.plan.uniforms };
  }, address);
  assert.equal(uniforms, 224);
  assert.ok(psnr(webgl, webgpu) >= 60, `${psnr(webgl, webgpu)} dB`);
  assert.deepEqual(trouble, []);
  await other.close();
});

test("a three.js that is too old for WebGPU is told of", async () => {
  const { page: other } = await newPage(browser);
  await openOther(other, server, "floor");
  const address = server.offer("old.mipvog", readFileSync(join(FIXTURES, "baked", "tiny.rate.mipvog")));
  assert.deepEqual(await other.evaluate((address) => window.refuse(address), address), ["With WebGPU, fields are drawn by three.js from release 187 on; this is 173."]);
  await other.close();
});
