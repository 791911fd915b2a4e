/** Modules of WebAssembly do what their plain forms do, bit for bit. Each is switched on once, so plain forms go first. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMetadata, type Triple } from "../src/format/metadata.js";
import { type DecodedPart, levelChunks, type LevelColors, LevelDecoder, type LevelEntry } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { prepareDecoding } from "../src/load/prepare.js";
import { sweepBoth } from "../src/load/skip.js";
import { sweepLanes } from "../src/load/sweeps.js";
import { night, ROOT } from "./support.js";

/** Containers of codes of one byte and of more, with one group of colours and with several, with inherited blocks and without. */
const NAMES = ["tiny.rate", "tiny.rate.filled", "tiny.12bit", "tiny.rate.f16", "dvgo.f16", "harmonics", "harmonics.filled", "linear"];
/** Shares of cells that are not empty. */
const SHARES = [0, 0.001, 0.05, 0.5];
/** Macro cells along the axes: rows of less than a vector, of whole ones, and of a part more. */
const COUNTS: Triple[] = [[1, 1, 1], [3, 5, 7], [6, 1, 16], [9, 4, 37], [20, 33, 128]];

/** All that the device gets of a container. */
function laidOut(name: string): { parts: DecodedPart[]; entry: LevelEntry }[] {
  const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
  const entries = readDirectory(readHeader(bytes), bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  const whole = plan(metadata, { side: 2048, bytes: 2 ** 30, uniforms: 1024 }, 0);
  let coarser: LevelColors | null = null;
  const levels = [];
  for (let level = metadata.levels.length - 1; level >= 0; level--) {
    const decoder: LevelDecoder = new LevelDecoder(metadata, whole, level, levelChunks(entries, level, bytes, 0), coarser);
    const { blocks_stored: blocks } = metadata.levels[level];
    // Two ranges, so that bricks need frames of the next part, and codes are wanted from the middle on.
    const parts = [...decoder.parts(0, blocks >> 1), ...decoder.parts(blocks >> 1, blocks)];
    levels.push({ parts, entry: decoder.entry(decoder.marks, true) });
    coarser = decoder.colors();
  }
  return levels;
}

/** Cells of which a share is 0, the others 255. */
function cells([x, y, z]: Triple, share: number): Uint8Array {
  let grain = 7;
  return Uint8Array.from({ length: x * y * z }, () => {
    grain = (Math.imul(grain, 1664525) + 1013904223) >>> 0;
    return grain < share * 2 ** 32 ? 0 : 255;
  });
}

/** Distances as they are defined. */
function measured(from: Uint8Array, [, ny, nz]: Triple): Uint8Array {
  const at = (cell: number) => [Math.floor(cell / nz / ny), Math.floor(cell / nz) % ny, cell % nz];
  const empty = Array.from(from.keys()).filter((cell) => from[cell] === 0).map(at);
  return from.map((_, cell) => Math.min(255, ...empty.map((other) => Math.max(...at(cell).map((place, axis) => Math.abs(place - other[axis]))))));
}

night("what the device gets is the same without WebAssembly", async () => {
  const plain = NAMES.map(laidOut);
  const swept = COUNTS.map((counts) =>
    SHARES.map((share) => {
      const some = cells(counts, share);
      assert.equal(sweepLanes(some, counts), false);
      sweepBoth(some, counts);
      if (some.length < 2000) assert.deepEqual(some, measured(cells(counts, share), counts), `${counts}`);
      return some;
    }),
  );
  await prepareDecoding();
  NAMES.forEach((name, i) => assert.deepEqual(laidOut(name), plain[i], name));
  COUNTS.forEach((counts, i) =>
    SHARES.forEach((share, j) => {
      const some = cells(counts, share);
      assert.equal(sweepLanes(some, counts), true);
      assert.deepEqual(some, swept[i][j], `${counts}`);
    }),
  );
});
