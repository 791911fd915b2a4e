/** Codes of a block are the same by both forms of their rule, and parts of a level are those of the whole. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { restore, restoreWide } from "../src/format/codings/restore.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMetadata } from "../src/format/metadata.js";
import { levelChunks, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { ROOT } from "./support.js";

/** Numbers from 0 to below `end`, by a congruential generator. */
function numbers(seed: number): (end: number) => number {
  let state = seed;
  return (end) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * end);
  };
}

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

for (const name of ["tiny.rate", "tiny.12bit", "dvgo.f32", "harmonics", "tiny.rate.filled"]) {
  test(`blocks of ${name} do not depend on where a share of them starts`, () => {
    const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
    const header = readHeader(bytes);
    const entries = readDirectory(header, bytes);
    const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
    const laidOut = plan(metadata, { side: 2048, floatLinear: true, bytes: 2 ** 30 }, 0);
    let coarser = null;
    for (let level = metadata.levels.length - 1; level >= 0; level--) {
      const chunks = levelChunks(entries, level, bytes, 0);
      const decoder: LevelDecoder = new LevelDecoder(metadata, laidOut, level, chunks, coarser);
      const count = metadata.levels[level].blocks_stored;
      if (count === 0) continue;
      const [whole] = decoder.parts(0, count);
      const shares = new LevelDecoder(metadata, laidOut, level, chunks, coarser);
      const middle = Math.floor(count / 3);
      const parts = [[0, middle], [middle, count]].flatMap(([from, to]) => [...shares.parts(from, to)]);
      assert.deepEqual(parts.flatMap(({ color }) => Array.from(color)), Array.from(whole.color));
      if (whole.density) assert.deepEqual(parts.flatMap(({ density }) => Array.from(density!)), Array.from(whole.density));
      assert.deepEqual(shares.marks, decoder.marks);
      coarser = decoder.colors();
    }
  });
}
