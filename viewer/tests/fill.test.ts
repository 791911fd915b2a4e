/** Filled blocks: this reader's colours are those that the program unpacks, bit for bit. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { values } from "../src/format/codings/values.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { blockCounts, readMetadata } from "../src/format/metadata.js";
import { levelChunks, type LevelColors, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { program, ROOT, temporaryFolder } from "./support.js";

const CONTAINER = join(ROOT, "fixtures", "baked", "tiny.rate.filled.mipvog");

/** The arrays of a safetensors file. */
function arrays(path: string): (name: string) => Float32Array {
  const bytes = readFileSync(path);
  const start = 8 + Number(bytes.readBigUInt64LE(0));
  const entries = JSON.parse(bytes.subarray(8, start).toString("utf8"));
  return (name) => {
    const [begin, end] = entries[name].data_offsets;
    return new Float32Array(Uint8Array.from(bytes.subarray(start + begin, start + end)).buffer);
  };
}

test("colours of inherited blocks are the program's", () => {
  const folder = temporaryFolder();
  const unpacked = join(folder.path, "unpacked.safetensors");
  program("unpack", CONTAINER, "--quiet", "-o", unpacked);
  const array = arrays(unpacked);
  const bytes = Uint8Array.from(readFileSync(CONTAINER));
  const header = readHeader(bytes);
  assert.ok(header.inherited);
  const entries = readDirectory(header, bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  const laidOut = plan(metadata, { side: 2048, floatLinear: true, bytes: 2 ** 30 }, 0);
  let coarser: LevelColors | null = null;
  let compared = 0;
  for (let level = metadata.levels.length - 1; level >= 0; level--) {
    const colors: LevelColors = new LevelDecoder(metadata, laidOut, level, levelChunks(entries, level, bytes, 0), coarser).colors();
    coarser = colors;
    const of = metadata.levels[level];
    const [nx, ny, nz] = of.dimensions;
    const [, by, bz] = blockCounts(of);
    const edge = of.block_size;
    for (const [kind, name] of [["DIFF", "diffuse"], ["FEAT", "features"]]) {
      const { codes, frames, encoding, channels } = colors[kind];
      const expected = array(`level${level}.${name}`);
      const value = values(encoding, kind, (value) => value);
      for (let node = 0; node < nx * ny * nz; node++) {
        const at = [Math.floor(node / ny / nz), Math.floor(node / nz) % ny, node % nz];
        const [i, j, k] = at.map((at) => Math.floor(at / edge));
        const [x, y, z] = at.map((at) => at % edge);
        const frame = frames[(i * by + j) * bz + k];
        if (frame < 0) continue;
        for (let channel = 0; channel < channels; channel++) {
          const found = value(codes[(frame * channels + channel) * edge ** 3 + (x * edge + y) * edge + z]);
          assert.equal(found, expected[channel * nx * ny * nz + node], `level ${level} ${name} ${at}`);
          compared++;
        }
      }
    }
  }
  folder.remove();
  assert.ok(compared > 1000, `${compared} values`);
});
