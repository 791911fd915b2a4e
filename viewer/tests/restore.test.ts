/** Codes of a block are the same by both forms of their rule, and parts of a level are those of the whole. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { CODINGS } from "../src/format/codings/index.js";
import { prepareLanes, restoreLanes, type Run } from "../src/format/codings/lanes.js";
import { restore, restoreWide } from "../src/format/codings/restore.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMetadata } from "../src/format/metadata.js";
import { levelChunks, type LevelColors, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { numbers, ROOT } from "./support.js";

for (const [bytes, origin] of [[1, 0], [2, 0], [2, 0x8000]] as const) {
  test(`codes of ${bytes} bytes around ${origin} do not depend on the form of the rule`, () => {
    const next = numbers(17 + bytes + origin);
    for (let round = 0; round < 200; round++) {
      const edge = 1 + next(9);
      const nodes = edge ** 3;
      const [most, bias] = bytes === 1 ? [0xff, 0x80] : [0xffff, 0x8080];
      const share = next(5);
      const mask = Int32Array.from({ length: nodes }, () => (next(4) < share ? -1 : 0));
      let count = 0;
      const rank = mask.map((bit) => (bit ? count++ : 0));
      const block = { edge, origin, most, mask, rank };
      const kind = bytes === 1 ? Uint8Array : Uint16Array;
      const values = new kind(count + 3).map(() => next(most + 1));
      const weights = Int8Array.from({ length: 5 }, () => next(256) - 128);
      const before = [0, 1, 2].map(() => Int32Array.from({ length: nodes }, () => next(2 * most + 1) - most));
      const [codes, own] = [new kind(nodes + 2), new Int32Array(nodes)];
      restore(block, { values, first: 2, bias }, { weights, before: [before[0], before[1], before[2]] }, codes, 1, own);
      const [wideCodes, wideOwn] = [new kind(nodes + 2), new Float64Array(nodes)];
      restoreWide(block, { values, first: 2, bias }, { weights, before: before.map((of) => Float64Array.from(of)) }, wideCodes, 1, wideOwn);
      assert.deepEqual(codes, wideCodes);
      assert.deepEqual(Array.from(own), Array.from(wideOwn));
    }
  });
}

test("codes of runs in vectors are those of block after block", async () => {
  const next = numbers(29);
  const bytes = (count: number) => Uint8Array.from({ length: count }, () => next(256));
  assert.equal(restoreLanes(emptyRun(), new Uint8Array(0)), false);
  await prepareLanes();
  for (let round = 0; round < 60; round++) {
    const [frames, channels, edge, modes] = [1 + next(19), 1 + next(6), 1 + next(9), 1 + next(4)];
    const nodes = edge ** 3;
    const masks = Array.from({ length: frames }, () => Int32Array.from({ length: nodes }, () => -next(2)));
    const starts = new Int32Array(frames);
    let live = 0;
    masks.forEach((mask, frame) => {
      starts[frame] = live;
      live += mask.filter((bit) => bit).length;
    });
    const liveBytes = Math.ceil(nodes / 8);
    const bits = new Uint8Array(frames * liveBytes);
    masks.forEach((mask, frame) => mask.forEach((bit, node) => (bits[frame * liveBytes + (node >> 3)] |= -bit << (node & 7))));
    // Channels that do not exist have weight 0.
    const weights = Array.from({ length: modes }, () => Array.from({ length: channels }, (_, channel) => Int8Array.from(bytes(5), (byte, i) => (i < 2 + channel ? byte : 0))));
    const run: Run = { frames, channels, edge, live, residuals: bytes(live * channels), starts, modes: bytes(frames).map((byte) => byte % modes), weights, bits };
    const codes = new Uint8Array(frames * channels * nodes);
    assert.equal(restoreLanes(run, codes), true);
    const plain = new Uint8Array(codes.length);
    masks.forEach((mask, frame) => {
      let count = 0;
      const rank = mask.map((bit) => (bit ? count++ : 0));
      const own = [0, 1, 2, 3].map(() => new Int32Array(nodes));
      for (let channel = 0; channel < channels; channel++) {
        const before = [own[(channel + 3) & 3], own[(channel + 2) & 3], own[(channel + 1) & 3]] as const;
        const values = { values: run.residuals, first: channel * live + starts[frame], bias: 0x80 };
        const block = { edge, origin: 0, most: 0xff, mask, rank };
        restore(block, values, { weights: weights[run.modes[frame]][channel], before }, plain, (frame * channels + channel) * nodes, own[channel & 3]);
      }
    });
    assert.deepEqual(codes, plain);
  }
});

/** A run of no blocks. */
function emptyRun(): Run {
  const none = new Uint8Array(0);
  return { frames: 0, channels: 1, edge: 1, live: 0, residuals: none, starts: new Int32Array(0), modes: none, weights: [], bits: none };
}

/** Files whose coarser levels look different from each side. */
const WITH_SIDES = ["tiny.rate", "harmonics", "tiny.rate.filled", "tiny.fit.filled"];

for (const name of [...WITH_SIDES, "tiny.12bit", "dvgo.f32"]) {
  test(`blocks of ${name} do not depend on where a share of them starts`, () => {
    const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
    const header = readHeader(bytes);
    const entries = readDirectory(header, bytes);
    const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
    const laidOut = plan(metadata, { side: 2048, bytes: 2 ** 30, uniforms: 1024 }, 0);
    let coarser: LevelColors | null = null;
    for (let level = metadata.levels.length - 1; level >= 0; level--) {
      const chunks = levelChunks(entries, level, bytes, 0);
      const decoder: LevelDecoder = new LevelDecoder(metadata, laidOut, level, chunks, coarser);
      const count = metadata.levels[level].blocks_stored;
      if (count === 0) continue;
      const [whole] = decoder.parts(0, count);
      const middle = Math.floor(count / 3);
      const { blocks_filled: inherited = 0 } = metadata.levels[level];
      const marks: Uint8Array[] = [];
      const parts = [[0, middle], [middle, count]].flatMap(([from, to]) => {
        // A helper has no more than it needs.
        const share: LevelDecoder = new LevelDecoder(metadata, laidOut, level, inherited ? chunks : decoder.share(from, to), coarser);
        const made = [...share.parts(from, to)];
        if (share.marks) marks.push(share.marks);
        return made;
      });
      // A part has the first quadruple of channels of all its blocks, then the next one.
      const joined = (bricks: (Uint8Array | Uint16Array)[], quads: number) =>
        Array.from({ length: quads }, (_, quad) => bricks.flatMap((one) => Array.from(one.subarray((quad * one.length) / quads, ((quad + 1) * one.length) / quads)))).flat();
      assert.deepEqual(joined(parts.map(({ color }) => color), laidOut.quads), Array.from(whole.color));
      assert.equal(whole.directional === null, !WITH_SIDES.includes(name) || level === 0);
      if (whole.directional) assert.deepEqual(joined(parts.map(({ directional }) => directional!), laidOut.directionalQuads), Array.from(whole.directional));
      if (whole.density) assert.deepEqual(parts.flatMap(({ density }) => Array.from(density!)), Array.from(whole.density));
      if (whole.density) assert.deepEqual(marks[0].map((mark, cell) => mark | marks[1][cell]), decoder.marks);
      coarser = decoder.colors();
    }
  });
}

test("a share of a level is about as large as the part of the level that it is of", () => {
  const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog")));
  const atlas = { encoding: readMetadata(chunkBytes(readDirectory(readHeader(bytes), bytes)[0], bytes, 0)).levels[0].diffuse, channels: 1, edge: 1, frames: 40, name: "DIFF" };
  // 4 runs of 10 frames, each 100 stored bytes.
  const chunk = new Uint8Array(24 + 400).fill(7, 24);
  new Uint32Array(chunk.buffer).set([10, 4, ...Array(4).fill(0x80000064)]);
  const sizes = [[0, 10], [5, 15], [0, 40], [40, 40]].map(([from, to]) => CODINGS.DIFF.share(atlas, chunk, from, to).length);
  assert.deepEqual(sizes, [124, 224, 424, 24]);
});
