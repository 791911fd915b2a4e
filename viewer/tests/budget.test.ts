/** A field in less memory than it takes whole: what is near the camera is fine, and nothing is coarser than the next level. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { blockCounts, type Metadata, readMetadata } from "../src/format/metadata.js";
import { partsFrom, partsOf } from "../src/format/parts.js";
import { Blocks } from "../src/load/blocks.js";
import { levelChunks } from "../src/load/level.js";
import { type DeviceLimits, plan } from "../src/load/plan.js";
import { Residents, runsOf } from "../src/load/residents.js";
import { capture, CountingServer, launch, loseDevice, newPage, night, openOther, psnr, ready, ROOT, type View } from "./support.js";
import type {} from "./others/babylon.scenes.js";

const WORLD = join(ROOT, "fixtures", "baked", "boxes.mipvog");
const DEVICE: DeviceLimits = { side: 2048, bytes: 2 ** 31, uniforms: 1024 };
/** Places in the innermost box, and where one looks from them. */
const SPOTS: [number[], number][] = [[[-0.6, -0.4, 0.2], 0.4], [[0.5, -0.5, 0], 2.4], [[0.7, 0.7, 0.3], 3.9], [[0, 0, 0.5], 0]];
const server = new CountingServer();
let browser: Browser;

before(async () => {
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

function metadataOf(path: string): Metadata {
  const bytes = new Uint8Array(readFileSync(path));
  return readMetadata(chunkBytes(readDirectory(readHeader(bytes), bytes)[0], bytes, 0));
}

/**
 * Less than a fifth of a world's blocks have room in half of its memory: where not all of them have, each has room for all values
 * that any of them has. In less, the 34 blocks that come before the finest level would leave nothing for that one.
 */
function half(metadata: Metadata): number {
  const bytes = plan(metadata, DEVICE, 0).bytes / 2;
  const room = plan(metadata, { ...DEVICE, bytes }, 0).slots.reduce((product, count) => product * count, 1);
  assert.ok(5 * room < partsOf(metadata).reduce((sum, { blocks_stored: blocks }) => sum + blocks, 0), `${room} slots`);
  return Math.floor(bytes);
}

test("a layout keeps to its bytes, and says how many the coarsest level needs", () => {
  const metadata = metadataOf(WORLD);
  const whole = plan(metadata, DEVICE, 0);
  assert.equal(whole.isPartial, false);
  for (const share of [0.9, 0.5, 0.3, 0.2]) {
    const bytes = Math.floor(whole.bytes * share);
    const some = plan(metadata, { ...DEVICE, bytes }, 0);
    assert.equal(some.isPartial, true);
    assert.ok(some.bytes <= bytes && some.bytes > 0.7 * bytes, `${some.bytes} of ${bytes}`);
    assert.equal(some.most, bytes);
  }
  assert.throws(() => plan(metadata, { ...DEVICE, bytes: 1000 }, 0), { name: "FieldError", message: /coarsest level needs [\d.]+ MB of textures; 0\.0 MB are allowed/ });
});

test("slots go to what looks coarsest, each block's coarser one before it, and nothing is given twice", () => {
  const metadata = metadataOf(WORLD);
  const some = plan(metadata, { ...DEVICE, bytes: plan(metadata, DEVICE, 0).bytes / 3 }, 0);
  const residents = new Residents(metadata, some);
  const room = some.slots[0] * some.slots[1] * some.slots[2];
  // Two levels of box 0, of all blocks.
  const all = (count: number) => Array.from({ length: count ** 3 }, (_, i): [number, number, number] => [Math.floor(i / count ** 2), Math.floor(i / count) % count, i % count]);
  const counts = [1, 0].map((level) => Math.ceil(metadata.levels[level].dimensions[0] / metadata.levels[level].block_size));
  residents.add(1, all(counts[0]));
  residents.add(0, all(counts[1]));
  const taken = () => [1, 0].map((part, i) => all(counts[i]).map((_, block) => residents.slotOf(part, block)));
  for (const camera of [[0.9, 0.9, 0.9], [-0.9, 0.9, -0.9], [50, 0, 0], [0, 0, 0]]) {
    residents.look({ place: camera, forward: [1, 0, 0], cosine: camera[0] > 1 ? -1 : 0.7 });
    const before = taken();
    const changes = residents.settle();
    const [coarse, fine] = taken();
    const slots = [...coarse, ...fine].filter((slot) => slot !== null);
    assert.equal(new Set(slots).size, slots.length);
    assert.equal(slots.length, Math.min(room, coarse.length + fine.length));
    assert.deepEqual(residents.count, [slots.length, coarse.length + fine.length]);
    all(counts[1]).forEach((place, block) => {
      const [x, y, z] = place.map((at) => Math.min(counts[0] - 1, Math.floor(at / 2)));
      if (fine[block] !== null) assert.notEqual(coarse[(x * counts[0] + y) * counts[0] + z], null, `${place} without its coarser block`);
    });
    for (const { part, gained } of changes) for (const block of gained) assert.equal(before[1 - part][block], null);
    // Who does not move changes nothing.
    assert.deepEqual(residents.settle(), []);
  }
  assert.deepEqual(runsOf([1, 2, 5, 90], 4), [[1, 6], [90, 91]]);
});

/** Bytes of all textures of the page that were made since the last call. */
async function counting(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const texels: Record<number, number> = { 0x8229: 1, 0x8058: 4, 0x822e: 4, 0x822d: 2, 0x881a: 8, 0x8236: 4, 0x8d7c: 4 };
    const counted = window as unknown as { allocated: number };
    counted.allocated = 0;
    const { texStorage3D } = WebGL2RenderingContext.prototype;
    WebGL2RenderingContext.prototype.texStorage3D = function (target, levels, format, x, y, z) {
      counted.allocated += (texels[format] ?? NaN) * x * y * z;
      texStorage3D.call(this, target, levels, format, x, y, z);
    };
  });
}

/** Cameras in the innermost box, and what they look at. */
function looking([x, y, z]: number[], angle: number, size: number): View {
  const back = [-Math.cos(angle), -Math.sin(angle), 0];
  const right = [Math.sin(angle), -Math.cos(angle), 0];
  return { width: size, height: size, toWorld: [[right[0], 0, back[0], x], [right[1], 0, back[1], y], [0, 1, 0, z], [0, 0, 0, 1]], focal: 0.8 * size };
}

/** The picture of a view once all blocks that it wants are there. */
async function settled(page: Page, view: View): Promise<number[]> {
  const rests = () => window.__mipvog.stage.settled && !window.__mipvog.field!.decoding && !window.__mipvog.field!.waiting;
  // The page's own camera must not look elsewhere meanwhile.
  await page.evaluate(({ toWorld, focal, width }) => {
    const { stage, field } = window.__mipvog;
    field!.updateWorldMatrix(true, false);
    const at = (ahead: number) => {
      const [x, y, z] = toWorld.map((row) => row[3] - ahead * row[2]);
      return field!.localToWorld(stage.camera.position.clone().set(x, y, z));
    };
    stage.viewpoint = { position: at(0), target: at(0.1), fov: (360 / Math.PI) * Math.atan(width / 2 / focal) };
  }, view);
  // Whoever draws tells where it looks from.
  await capture(page, view);
  await page.waitForFunction(rests);
  return capture(page, view);
}

test("with room for less than a fifth of a world's blocks, the next coarser level of all that is seen is there", () => {
  const bytes = new Uint8Array(readFileSync(WORLD));
  const entries = readDirectory(readHeader(bytes), bytes);
  const metadata = metadataOf(WORLD);
  const some = plan(metadata, { ...DEVICE, bytes: half(metadata) }, 0);
  const residents = new Residents(metadata, some);
  const parts = partsFrom(metadata, 0);
  const tables = new Map(parts.map((part) => {
    const blocks = new Blocks(blockCounts(partsOf(metadata)[part]), levelChunks(entries, part, bytes, 0).TABL, true);
    residents.add(part, blocks.places);
    return [part, blocks];
  }));
  for (const [place, angle] of SPOTS) {
    residents.look({ place, forward: [Math.cos(angle), Math.sin(angle), 0], cosine: 0.7 });
    residents.settle();
    for (const part of parts.filter((part) => part > 0 && part < metadata.levels.length)) {
      tables.get(part)!.places.forEach((_, block) => assert.notEqual(residents.slotOf(part, block), null, `level ${part}, block ${block}`));
    }
    const fine = parts.filter((part) => part === 0 || part >= metadata.levels.length);
    const held = fine.map((part) => tables.get(part)!.places.filter((_, block) => residents.slotOf(part, block) !== null).length);
    assert.ok(held.at(-1)! > 5, `finest blocks around: ${held}`);
  }
});

night("a world with room for less than a fifth of its blocks looks better than as many whole levels, and a device that was lost gets it back", async () => {
  const bytes = readFileSync(WORLD);
  const most = half(metadataOf(WORLD));
  const fitting = metadataOf(WORLD).levels.findIndex((_, level) => plan(metadataOf(WORLD), DEVICE, level).bytes <= most);
  const pictures: Record<string, number[][]> = {};
  for (const name of ["whole", "some"]) {
    const { page, problems } = await newPage(browser, { width: 64, height: 64 });
    await counting(page);
    await page.goto(`${server.page("world.mipvog", bytes)}${name === "some" ? `&max-bytes=${most}` : ""}`);
    await ready(page);
    const budget = await page.evaluate(() => window.__mipvog.field!.budget!);
    const allocated = await page.evaluate(() => (window as unknown as { allocated: number }).allocated);
    assert.equal(allocated, budget.bytes);
    if (name === "some") {
      assert.ok(allocated <= most, `${allocated} of ${most}`);
      assert.ok(budget.blocks[0] < budget.blocks[1] && budget.blocks[0] > 0);
    } else assert.equal(budget.blocks[0], budget.blocks[1]);
    pictures[name] = [];
    for (const [place, angle] of SPOTS) pictures[name].push(await settled(page, looking(place, angle, 48)));
    if (name === "whole") {
      // As many whole levels as have room.
      pictures.coarser = [];
      await page.evaluate((level) => (window.__mipvog.field!.fixedLevel = level), fitting);
      for (const [place, angle] of SPOTS) pictures.coarser.push(await capture(page, looking(place, angle, 48)));
    } else {
      // What a lost device held comes again.
      await (await loseDevice(page))();
      await page.waitForFunction(() => window.__mipvog.field!.finest === 0 && !window.__mipvog.field!.decoding && !window.__mipvog.field!.waiting);
      const [place, angle] = SPOTS.at(-1)!;
      // Those that had a slot before have it sooner, so that the way to a place tells a little.
      const [again, before] = [await settled(page, looking(place, angle, 48)), pictures.some.at(-1)!].map((picture) => psnr(picture, pictures.whole.at(-1)!));
      assert.ok(Math.abs(again - before) < 1, `${again} after ${before}`);
    }
    assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
    await page.close();
  }
  SPOTS.forEach((_, i) => {
    const some = psnr(pictures.some[i], pictures.whole[i]);
    const coarser = psnr(pictures.coarser[i], pictures.whole[i]);
    assert.ok(some > coarser + 1, `spot ${i}: ${some} dB, whole levels ${coarser} dB`);
  });
});

night("Babylon.js draws an object in less memory, finely where the camera is", async () => {
  const path = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
  const whole = plan(metadataOf(path), DEVICE, 0).bytes;
  const address = server.offer("object.mipvog", readFileSync(path));
  const { page, problems } = await newPage(browser);
  await openOther(page, server, "babylon.scenes");
  const [wanted, some, coarser, budget] = await page.evaluate(async ([address, maxBytes]) => {
    const { RadianceField, sceneOf, picture } = window.babylon;
    const draw = async (options: object, level: number | null) => {
      const { scene, engine } = sceneOf(true, [3, 1, 1]);
      const field = new RadianceField(address as string, scene, options);
      field.fixedLevel = level;
      await picture(scene);
      // Blocks follow the camera after it was drawn from.
      do {
        scene.render();
        await new Promise(requestAnimationFrame);
      } while (field.decoding || field.waiting);
      const pixels = await picture(scene);
      const { budget } = field;
      engine.dispose();
      return [pixels, budget!] as const;
    };
    const some = await draw({ maxBytes }, 0);
    return [(await draw({}, 0))[0], some[0], (await draw({}, 1))[0], some[1]] as const;
  }, [address, Math.floor(whole * 0.6)] as const);
  assert.ok(budget.bytes <= 0.6 * whole && budget.blocks[0] < budget.blocks[1], JSON.stringify(budget));
  const [kept, lost] = [psnr(some, wanted), psnr(coarser, wanted)];
  assert.ok(kept > lost, `${kept} dB, the next coarser level ${lost} dB`);
  assert.deepEqual(problems.filter((problem) => !problem.includes("ReadPixels")), []);
  await page.close();
});
