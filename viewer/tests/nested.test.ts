/** Worlds, whose boxes lie around each other: what of them is refused, how they look from inside, and where the page starts. */

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { checkContents } from "../src/format/contents.js";
import { chunkBytes, type Entry, readDirectory, readHeader } from "../src/format/layout.js";
import { type Metadata, readMetadata, requiredFeatures } from "../src/format/metadata.js";
import { boxesOf, boxesReading, boxOfPart, inheritedFrom, outerBounds, partsFrom } from "../src/format/parts.js";
import { lastSample } from "../src/format/shells.js";
import { Blocks } from "../src/load/blocks.js";
import { freePlace } from "../src/load/skip.js";
import { withMetadata } from "./metadata.js";
import { capture, CountingServer, launch, newPage, night, pixels, program, psnr, ready, ROOT, storedFrame, temporaryFolder, views } from "./support.js";

const WORLD = join(ROOT, "fixtures", "baked", "boxes.mipvog");
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

/** The directory and the metadata of a world, after a change of both. */
function changed(change: (metadata: Required<Metadata>, entries: Entry[]) => void): () => Metadata {
  const bytes = readFileSync(WORLD);
  const header = readHeader(bytes);
  const entries = readDirectory(header, bytes);
  const metadata = JSON.parse(new TextDecoder().decode(chunkBytes(entries[0], bytes, 0)));
  change(metadata, entries);
  return () => {
    const read = readMetadata(new TextEncoder().encode(JSON.stringify(metadata)));
    checkContents(entries, read, header);
    return read;
  };
}

test("a world's parts span boxes around each other, and come coarse to fine with a shell before its level", () => {
  const metadata = changed(() => {})();
  const { levels, shells = [] } = metadata;
  assert.equal(shells.length, 3);
  const count = levels.length;
  assert.deepEqual(partsFrom(metadata, 0).slice(-7), [count + 2, 3, count + 1, 2, count, 1, 0]);
  assert.deepEqual(boxesOf(metadata).map(({ max }) => max[0]), [1, 2, 4, 8]);
  assert.equal(outerBounds(metadata).min[2], -8);
  assert.deepEqual([0, 1, 2, 3, count, count + 2].map((part) => boxOfPart(metadata, part)), [0, 0, 1, 2, 1, 3]);
  assert.deepEqual(boxesReading(metadata, 3), [0, 1, 2]);
  assert.deepEqual(boxesReading(metadata, count + 1), [2]);
  // Level 1 spans the box of level 0, level 2 another one; the shell of level 1 spans that of level 2.
  assert.deepEqual([0, 1, 2, count].map((part) => inheritedFrom(metadata, part)), [1, null, null, 2]);
  assert.ok(requiredFeatures(metadata).has("nested_boxes"));
  const edge = 16 / metadata.march.voxel_size / metadata.march.stepsize;
  assert.equal(lastSample(metadata), Math.floor(edge * Math.sqrt(3)) + 1);
});

const REFUSED: [string, (metadata: Required<Metadata>, entries: Entry[]) => void, RegExp][] = [
  ["as many shells as levels", ({ levels, shells }) => void (levels.length = shells.length), /shells should be fewer than levels/],
  ["a shell without a box", ({ shells }) => delete shells[1].bounds, /shells\[1\]\.bounds should be there/],
  ["a level with a box", ({ levels, bounds }) => (levels[1].bounds = bounds), /levels\[1\]\.bounds should be left out/],
  ["a box that does not hold the smaller one", ({ shells }) => (shells[1].bounds!.min[0] = -1.5), /shells\[1\]\.bounds should be a larger box/],
  ["a box that is no larger", ({ shells, bounds }) => (shells[0].bounds = bounds), /shells\[0\]\.bounds should be a larger box/],
  ["nodes more than 3 times as far apart", ({ shells }) => (shells[2].dimensions[1] = 20), /with nodes 1\.5 to 3 times/],
  ["nodes less than 1.5 times as far apart", ({ shells }) => (shells[0].dimensions[2] = 45), /with nodes 1\.5 to 3 times/],
  ["levels that are blended before activation", (metadata) => (metadata.blend = "before_activation"), /after_activation beside shells/],
  ["more steps than 2^24", ({ march }) => (march.stepsize = 1e-6), /at most 16777216/],
  ["samples outside of everything", (metadata) => (metadata.march.sampled = { min: [-9, -1, -1], max: [1, 1, 1] }), /within that of everything/],
  ["inherited blocks in level 1", ({ levels }) => (levels[1].blocks_filled = 1), /of the same box/],
  ["a level before its shell", (_, entries) => entries.push(...entries.splice(1, 6)), /missing or out of place/],
  ["a part that is not there", (_, entries) => (entries[entries.length - 1].part = 99), /missing or out of place/],
];
for (const [what, change, message] of REFUSED) {
  test(`a world with ${what} is refused`, () => {
    assert.throws(changed(change), { name: "FieldError", message });
  });
}

test("a table of runs is read, and one that lies is refused", () => {
  const table = (...bytes: number[]) => new Blocks([5, 5, 8], { name: "Chunk TABL", bytes: storedFrame(Uint8Array.from(bytes)) }, true);
  // 120 empty blocks, 80 stored ones; numbers are 4 * length + kind.
  const blocks = table(0xe0, 0x03, 0xc1, 0x02);
  assert.deepEqual([blocks.places.length, blocks.places[0]], [80, [3, 0, 0]]);
  assert.equal(table(0xa0, 0x06).places.length, 0);
  const lies = [
    [0xe0, 0x03], // too few
    [0xe0, 0x03, 0xc5, 0x02], // too many
    [0xe0, 0x03, 0xc0, 0x02], // the same kind twice
    [0xe0, 0x03, 0xc3, 0x02], // a kind that there is not
    [0xe0, 0x03, 0x01, 0xc1, 0x02], // no blocks
    [0xe0, 0x83, 0x00, 0xc1, 0x02], // a last byte of 0
    [0xe0, 0x03, 0xc1], // the middle of a number
    Array.from({ length: 12 }, () => 0xff),
  ];
  for (const lie of lies) assert.throws(() => table(...lie), { name: "FieldError" }, String(lie));
});

test("one stands in the middle of what is free", () => {
  const distances = new Uint8Array(8 * 8 * 8).fill(255);
  // Matter in the lower half along the last axis.
  for (let cell = 0; cell < distances.length; cell++) distances[cell] = cell % 8 < 3 ? 0 : (cell % 8) - 2;
  const [x, y, z] = freePlace(distances, [8, 8, 8], 1)!;
  assert.ok(Math.abs(x - 0.5) < 0.1 && Math.abs(y - 0.5) < 0.1 && z > 0.5 && z < 0.9, `${[x, y, z]}`);
  assert.equal(freePlace(distances, [8, 8, 8], 5), null);
  assert.equal(freePlace(distances.fill(0), [8, 8, 8], 1), null);
});

/** Places in the innermost box, and what is looked at from there. */
const LOOKS: [number[], number[]][] = [
  [[-0.6, -0.4, 0.2], [1, 0.2, 0]],
  [[0.5, -0.5, 0], [-0.7, 0.7, 0.2]],
  [[0, 0.8, 0.3], [0.1, -1, -0.2]],
  [[0.6, 0.6, -0.2], [0.5, 0.5, 0.8]],
  [[0.9, -0.9, 0.7], [3, -2, 0.3]],
  [[-0.2, 0.3, 0.4], [-3, 3, 0.9]],
];

function cameraFile(path: string): void {
  const unit = (v: number[]) => v.map((value) => value / Math.hypot(...v));
  const cross = (a: number[], b: number[]) => [0, 1, 2].map((axis) => a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3]);
  const frames = LOOKS.map(([from, to], number) => {
    const back = unit(from.map((value, axis) => value - to[axis]));
    const right = unit(cross([0, 0, 1], back));
    const up = cross(back, right);
    const matrix = [0, 1, 2].map((axis) => [right[axis], up[axis], back[axis], from[axis]]);
    return { file_path: `./test/inside_${number}`, transform_matrix: [...matrix, [0, 0, 0, 1]] };
  });
  writeFileSync(path, JSON.stringify({ camera_angle_x: 1.2, frames }));
}

for (const name of ["boxes", "boxes.filled", "boxes.deep", "boxes.constant"]) {
  night(`${name} looks from inside as the reference renderer draws it, level by level`, async () => {
    let container = join(ROOT, "fixtures", "baked", `${name}.mipvog`);
    if (name === "boxes.constant") {
      container = join(folder.path, "boxes.constant.mipvog");
      // Samples are as far apart at every level as its box says.
      writeFileSync(container, withMetadata(readFileSync(WORLD), '"step_rule":"level_of_detail"', '"step_rule":"constant"'));
    }
    const cameras = join(folder.path, "cameras.json");
    cameraFile(cameras);
    const { levels } = JSON.parse(program("inspect", container, "--format", "json"));
    const { page, problems } = await newPage(browser);
    await page.goto(server.page(`${name}.mipvog`, readFileSync(container)));
    await ready(page);
    // Small pictures read between levels.
    const cases: [number | "auto", number, number[]][] = [["auto", 48, [0, 1, 2, 3, 4, 5]], ["auto", 16, [0, 1, 2, 3, 4, 5]], ["auto", 8, [0, 1, 2, 3, 4, 5]], [0, 48, [0, 3]], [1, 48, [1, 4]], [levels.length - 1, 48, [2, 5]]];
    for (const [level, size, frames] of cases) {
      const reference = join(folder.path, `${name}.${level}.${size}`);
      program("render", container, "--cameras", cameras, "--size", `${size}x${size}`, "--frames", frames.join(), "--level-of-detail", String(level), "-o", reference);
      await page.evaluate((level) => (window.__mipvog.field!.fixedLevel = typeof level === "number" ? level : null), level);
      for (const number of frames) {
        const found = psnr(await capture(page, views(cameras, size)[number]), await pixels(page, join(reference, `inside_${number}.s1.png`)));
        // The lowest is 60 dB.
        assert.ok(found >= 55, `camera ${number}, level ${level}: ${found} dB`);
      }
    }
    // A march that skips reads less than one that looks at everything.
    await page.evaluate(() => (window.__mipvog.field!.fixedLevel = null));
    const [sparse, dense] = await page.evaluate(() => [window.__mipvog.statistics(true)!, window.__mipvog.statistics(false)!]);
    assert.ok(sparse.rays > 1000 && sparse.fetchesPerRay < dense.fetchesPerRay, `${sparse.fetchesPerRay} of ${dense.fetchesPerRay}`);
    assert.deepEqual(problems, []);
    await page.close();
  });
}

test("the first part of a world looks as the reference renderer draws it", async () => {
  // No buffer of Node, whose slices share its bytes.
  const whole = new Uint8Array(readFileSync(WORLD));
  const { prefix } = readDirectory(readHeader(whole), whole).find(({ part }) => part === 2)!;
  const part = join(folder.path, "part.mipvog");
  writeFileSync(part, whole.subarray(0, prefix));
  const cameras = join(folder.path, "cameras.json");
  cameraFile(cameras);
  program("render", part, "--cameras", cameras, "--size", "48x48", "--frames", "0,4", "-o", join(folder.path, "part"));
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("part.mipvog", readFileSync(part)));
  await ready(page);
  assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), 2);
  for (const number of [0, 4]) {
    const found = psnr(await capture(page, views(cameras, 48)[number]), await pixels(page, join(folder.path, "part", `inside_${number}.s1.png`)));
    assert.ok(found >= 45, `camera ${number}: ${found} dB`);
  }
  assert.deepEqual(problems, []);
  await page.close();
});

test("a page starts in the free space of a world, flies there, and does not leave it far", async () => {
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("boxes.mipvog", readFileSync(WORLD)));
  await ready(page);
  const start = await page.evaluate(() => {
    const { stage, field } = window.__mipvog;
    const box = field!.visibleBounds.applyMatrix4(field!.matrixWorld);
    const { position, target } = stage.viewpoint;
    return { isInside: box.containsPoint(position), level: target.y - position.y, way: stage.way, edge: box.max.x - box.min.x, outer: field!.bounds.max.x };
  });
  assert.deepEqual([start.isInside, start.way, start.edge, start.outer], [true, "fly", 2, 8]);
  assert.ok(Math.abs(start.level) < 1e-6, `${start.level}`);
  const [place, turned] = await page.evaluate(async () => {
    const { stage } = window.__mipvog;
    const frames = (count: number) => new Promise<void>((done) => (count > 0 ? requestAnimationFrame(() => void frames(count - 1).then(done)) : done()));
    stage.camera.position.set(50, -1, 0);
    await frames(3);
    const place = stage.camera.position.toArray();
    stage.reset();
    // What is turned around is what the middle of the picture shows.
    stage.camera.lookAt(stage.camera.position.x + 0.01, -5, stage.camera.position.z);
    stage.camera.updateMatrixWorld();
    stage.way = null;
    return [place, stage.controls.target.distanceTo(stage.camera.position)];
  });
  assert.deepEqual(place, [3, -1, 0]);
  assert.ok(turned > 0.3 && turned < 2, `${turned}`);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a page starts at a world's first camera where there is a file of them", async () => {
  const cameras = join(folder.path, "start.json");
  cameraFile(cameras);
  server.offer("start.json", readFileSync(cameras));
  const { page, problems } = await newPage(browser);
  await page.goto(`${server.page("boxes.mipvog", readFileSync(WORLD))}&cameras=start.json`);
  await ready(page);
  // Training's z is the page's y.
  await page.waitForFunction(() => Math.hypot(window.__mipvog.stage.camera.position.x + 0.6, window.__mipvog.stage.camera.position.y - 0.2, window.__mipvog.stage.camera.position.z - 0.4) < 1e-4);
  assert.deepEqual(problems, []);
  await page.close();
});
