/** Fields in Babylon.js: pictures against the reference renderer's, of either hand, among meshes, and what it refuses. */

import assert from "node:assert/strict";
import { cpSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { bakedScene, CountingServer, launch, newPage, night, openOther, pixels, program, psnr, ROOT, temporaryFolder, turntable } from "./support.js";
import type { BabylonLook } from "./others/asked.js";

// Pixels are smaller than voxels, so that every step of a ray is one of level 0.
const SIZE = 96;
const folder = temporaryFolder();
const at = (name: string) => join(folder.path, name);
const server = new CountingServer();
let browser: Browser;
let page: Page;
let problems: string[];

before(async () => {
  const baked = bakedScene("tiny");
  cpSync(baked.container, at("field.mipvog"));
  cpSync(baked.asset, at("field.glb"));
  await server.start();
  browser = await launch();
  ({ page, problems } = await newPage(browser));
  await openOther(page, server, "babylon.field");
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

/** How the reference renderer looks at a container. */
function lookAt(container: string): Omit<BabylonLook, "address" | "rightHanded"> {
  const { bounds } = JSON.parse(program("inspect", container, "--format", "json"));
  const [, { toWorld, focal }] = turntable(bounds, 3, SIZE);
  // Training's z to y.
  const turned = ([x, y, z]: number[]): [number, number, number] => [x, z, -y];
  const column = (number: number) => toWorld.slice(0, 3).map((row) => row[number]);
  const position = turned(column(3));
  const target = turned(column(2)).map((back, axis) => position[axis] - back) as [number, number, number];
  return { size: SIZE, position, target, angle: 2 * Math.atan((0.5 * SIZE) / focal), background: [1, 1, 1] };
}

function offer(path: string): string {
  return server.offer(path.split("/").pop()!, readFileSync(path));
}

/** The reference renderer's picture of a container. */
async function reference(container: string, name: string, ...options: string[]): Promise<number[]> {
  program("render", container, "--turntable", "3", "--frames", "1", "--size", `${SIZE}x${SIZE}`, "-o", at(name), ...options);
  return pixels(page, join(at(name), "turn_001.s1.png"));
}

for (const rightHanded of [true, false]) {
  const hand = rightHanded ? "right" : "left";

  (rightHanded ? test : night)(`a ${hand}-handed scene shows containers and assets as the reference renderer draws them`, async () => {
    const tiny = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
    for (const [container, source] of [[tiny, tiny], [at("field.mipvog"), at("field.glb")]]) {
      const wanted = await reference(container, `${hand}_${source.split(".").pop()}`);
      const picture = await page.evaluate((look) => window.drawBabylon(look), { ...lookAt(container), rightHanded, address: offer(source) });
      const found = psnr(picture, wanted);
      assert.ok(found >= 40, `${source}: ${found} dB`);
    }
    assert.deepEqual(problems, []);
  });

  (rightHanded ? test : night)(`a ${hand}-handed scene shows a world from inside as the reference renderer draws it`, async () => {
    const container = join(ROOT, "fixtures", "baked", "boxes.filled.mipvog");
    const frame = { file_path: "./inside", transform_matrix: [[0, 0, 1, 0.5], [1, 0, 0, -0.4], [0, 1, 0, 0.3], [0, 0, 0, 1]] };
    writeFileSync(at("inside.json"), JSON.stringify({ camera_angle_x: 1.2, frames: [frame] }));
    program("render", container, "--cameras", at("inside.json"), "--size", `${SIZE}x${SIZE}`, "-o", at(`${hand}_inside`));
    const look = { size: SIZE, position: [0.5, 0.3, 0.4], target: [-0.5, 0.3, 0.4], angle: 1.2, background: [1, 1, 1], address: offer(container), rightHanded } as BabylonLook;
    const found = psnr(await page.evaluate((look) => window.drawBabylon(look), look), await pixels(page, join(at(`${hand}_inside`), "inside.s1.png")));
    assert.ok(found >= 40, `${found} dB`);
    assert.deepEqual(problems, []);
  });

  (rightHanded ? test : night)(`a mesh of a ${hand}-handed scene hides what is behind it, and is seen through what is before it`, async () => {
    // Its rays through nothing have no colour of the network's.
    const container = join(ROOT, "fixtures", "baked", "harmonics.mipvog");
    const look = { ...lookAt(container), rightHanded, address: offer(container) };
    const draw = (wall: number) => page.evaluate((look) => window.drawBabylon(look), { ...look, wall });
    const before = await draw(0.1);
    assert.ok(before.every((value, at) => value === [255, 0, 0, 255][at % 4]), "all of it is the wall");
    const found = psnr(await draw(50), await reference(container, `${hand}_wall`, "--background", "1,0,0"));
    assert.ok(found >= 40, `${found} dB`);
    assert.deepEqual(problems, []);
  });
}

night("a field tells its bounds, what a picture takes, and what it shows at a point", async () => {
  const container = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
  const look = { ...lookAt(container), address: offer(container) };
  const at: [number, number][] = [[0.5, 0.5], [0.55, 0.45], [0.001, 0.001]];
  const ask = (rightHanded: boolean) => page.evaluate(([look, at]) => window.askBabylon(look, at), [{ ...look, rightHanded }, at] as const);
  const [right, left] = [await ask(true), await ask(false)];
  const { bounds } = JSON.parse(program("inspect", container, "--format", "json"));
  const wanted = await reference(container, "asked");
  for (const { told, pixels } of [right, left]) {
    assert.deepEqual(told.bounds, bounds);
    const { sparse, dense } = told.statistics;
    assert.ok(sparse.rays > 0 && sparse.rays === dense.rays && sparse.stepsPerRay === dense.stepsPerRay);
    assert.equal(dense.samplesPerRay, dense.stepsPerRay);
    assert.ok(sparse.samplesPerRay < dense.samplesPerRay && sparse.fetchesPerRay < dense.fetchesPerRay);
    told.picked.slice(0, 2).forEach((picked, number) => {
      const { point: [x, y, z], seen } = picked!;
      seen.forEach((share, axis) => assert.ok(Math.abs(share - at[number][axis]) < 1e-4, `${seen}`));
      // The field was turned from z up to y up, and a left-handed scene mirrors x.
      const local = [told === right.told ? x : -x, -z, y];
      assert.ok(local.every((value, axis) => value >= bounds.min[axis] && value <= bounds.max[axis]), `${local}`);
    });
    assert.equal(told.picked[2], null, "nothing is in the corner");
    // What was asked leaves no trace in the next picture.
    assert.ok(psnr(pixels, wanted) >= 40);
  }
  const [a, b] = [right, left].map(({ told }) => told.picked[0]!.point);
  assert.ok(Math.hypot(a[0] + b[0], a[1] - b[1], a[2] - b[2]) < 1e-3, `${a} and ${b}`);
  assert.deepEqual(problems, []);
});

night("a device that was lost gets the field back", async () => {
  const container = at("field.mipvog");
  const look = { ...lookAt(container), rightHanded: false, address: offer(container) };
  const [before, after] = await page.evaluate(async (look) => [await window.drawBabylon(look), await window.drawBabylon({ ...look, losesDevice: true })], look);
  assert.deepEqual(after, before);
  // Babylon.js tells that the device went and came.
  assert.deepEqual(problems.splice(0).filter((problem) => !/WebGL context (lost|successfully restored)\.$/.test(problem)), []);
});

test("a field that cannot be opened leaves the mesh of its node, and says why", async () => {
  const asset = readFileSync(at("field.glb"));
  const address = server.offer("sound.glb", asset);
  const kinds = async (address: string) => (await page.evaluate((address) => window.listBabylon(address), address)).map(({ kind, error }) => [kind, error]);
  assert.ok((await kinds(address)).some(([kind]) => kind === "RadianceField"));
  // The container's magic is the only one of its kind in the asset.
  const broken = Buffer.from(asset);
  broken[broken.indexOf(readFileSync(at("field.mipvog")).subarray(0, 8))] ^= 1;
  const found = await kinds(server.offer("broken.glb", broken));
  assert.ok(found.every(([kind]) => kind !== "RadianceField"));
  assert.match(found.find(([, error]) => error)![1]!, /no \.mipvog container/);
});

test("engines without WebGL 2 or WebGPU are refused", async () => {
  for (const answer of await page.evaluate((address) => window.refuseBabylon(address), offer(at("field.mipvog")))) {
    assert.match(answer, /^FieldError: Fields are drawn by Babylon\.js's engines for WebGL 2 and WebGPU/);
  }
});
