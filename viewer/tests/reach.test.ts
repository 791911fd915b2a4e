/** A share of a level has all that its bricks repeat of other blocks, wherever it ends. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMetadata, type Triple } from "../src/format/metadata.js";
import { Blocks } from "../src/load/blocks.js";
import { type DecodedPart, levelChunks, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { prepareDecoding } from "../src/load/prepare.js";
import { night, numbers, ROOT, storedFrame } from "./support.js";

/** The neighbours whose lowest nodes a block repeats, with itself. */
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => [bits & 1, (bits >> 1) & 1, bits >> 2]);
const GRIDS: Triple[] = [[1, 1, 1], [1, 1, 9], [1, 9, 1], [9, 1, 1], [11, 9, 3], [3, 9, 11], [2, 7, 5], [5, 2, 7], [4, 4, 4], [1, 6, 8], [8, 1, 6], [8, 6, 1]];
/** Containers without inherited blocks, whose levels helpers decode. */
const NAMES = ["tiny.rate", "tiny.12bit", "dvgo.f32", "dvgo.mask", "harmonics", "harmonics.f16", "linear"];

test("the frames before any end repeat nodes of no frame beyond their reach", () => {
  const next = numbers(5);
  let ends = 0;
  for (const counts of GRIDS) {
    for (let share = 1; share <= 10; share++) {
      const [nx, ny, nz] = counts;
      const stored = Uint8Array.from({ length: nx * ny * nz }, () => Number(next(10) < share));
      const blocks = new Blocks(counts, { name: "TABL", bytes: storedFrame(stored) });
      let furthest = 0;
      assert.equal(blocks.reach(0), 0);
      blocks.places.forEach(([x, y, z], frame) => {
        for (const [i, j, k] of CORNERS) furthest = Math.max(furthest, blocks.frame(x + i, y + j, z + k) + 1);
        const reach = blocks.reach(frame + 1);
        assert.ok(reach >= furthest, `${counts}: ${frame + 1} frames reach ${reach} of ${furthest}`);
        // Not all of the level, which helpers would wait for.
        assert.ok(reach === frame + 1 || blocks.places[reach - 1][0] <= x + 1, `${counts}: ${frame + 1} frames reach ${reach}`);
        ends++;
      });
    }
  }
  assert.ok(ends > 3000, `${ends} ends`);
});

interface Level {
  decoder: LevelDecoder;
  share(from: number, to: number): LevelDecoder;
  blocks: number;
  whole: DecodedPart;
}

/** The levels of a container, as the plain script decodes them in one part. */
function levelsOf(name: string): Level[] {
  const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
  const entries = readDirectory(readHeader(bytes), bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  const laidOut = plan(metadata, { side: 2048, bytes: 2 ** 30, uniforms: 1024 }, 0);
  return metadata.levels.flatMap(({ blocks_stored: blocks }, level) => {
    if (blocks === 0) return [];
    const decoder = new LevelDecoder(metadata, laidOut, level, levelChunks(entries, level, bytes, 0), null);
    const share = (from: number, to: number) => new LevelDecoder(metadata, laidOut, level, decoder.share(from, to), null);
    const [whole, ...others] = [...decoder.parts(0, blocks)];
    assert.equal(others.length, 0);
    return [{ decoder, share, blocks, whole }];
  });
}

/** Of bricks of so many quadruples of channels, those of some blocks, quadruple by quadruple. */
function bricksOf({ color, blocks }: DecodedPart, quads: number, from: number, to: number): DecodedPart["color"][] {
  const brick = color.length / quads / blocks;
  return Array.from({ length: quads }, (_, quad) => color.subarray((quad * blocks + from) * brick, (quad * blocks + to) * brick));
}

function compare(levels: Level[], helpers: number): void {
  for (const { share, blocks, whole } of levels) {
    const size = Math.ceil(blocks / helpers);
    for (let from = 0; from < blocks; from += size) {
      const to = Math.min(blocks, from + size);
      const [part] = [...share(from, to).parts(from, to)];
      const where = `level ${whole.part}: ${helpers} helpers, blocks ${from} to ${to}`;
      const quads = whole.color.length / (blocks * whole.side ** 3 * 4);
      assert.deepEqual(bricksOf(part, quads, 0, to - from), bricksOf(whole, quads, from, to), where);
      const nodes = whole.side ** 3;
      assert.deepEqual(part.density, whole.density?.slice(from * nodes, to * nodes) ?? null, where);
    }
  }
}

night("bricks of any number of helpers are those of the whole level, in plain script and in WebAssembly", async () => {
  const all = NAMES.map(levelsOf);
  for (let helpers = 1; helpers <= 16; helpers++) all.forEach((levels) => compare(levels, helpers));
  await prepareDecoding();
  for (let helpers = 1; helpers <= 16; helpers++) all.forEach((levels) => compare(levels, helpers));
});
