/** This reader's values are those that the program unpacks, bit for bit; inherited blocks among them. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { values } from "../src/format/codings/values.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { CODINGS } from "../src/format/codings/index.js";
import { blockCounts, type LevelMetadata, readMetadata } from "../src/format/metadata.js";
import { levelChunks, type LevelColors, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { prepareLanes } from "../src/format/codings/lanes.js";
import { prepareInflate } from "../src/format/zstd.js";
import { program, ROOT, temporaryFolder } from "./support.js";

const NAMES = ["tiny.rate.filled", "tiny.fit.filled", "tiny.rate", "tiny.12bit", "tiny.rate.f16", "dvgo.f16", "dvgo.f32", "harmonics", "harmonics.filled", "harmonics.f16", "linear"];
/** Names of the program's arrays. */
const ARRAYS: Record<string, string> = { DENS: "density", DIFF: "diffuse", FEAT: "features", BNDA: "features", BNDB: "features", BNDC: "features", DIRB: "directional", ANIS: "anisotropy" };
/** Channels of harmonics before a band. */
const BEFORE: Record<string, number> = { BNDB: 9, BNDC: 24 };

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

for (const name of NAMES) test(`values of ${name} are the program's`, async () => {
  const container = join(ROOT, "fixtures", "baked", `${name}.mipvog`);
  const folder = temporaryFolder();
  const unpacked = join(folder.path, "unpacked.safetensors");
  program("unpack", container, "--quiet", "-o", unpacked);
  const array = arrays(unpacked);
  folder.remove();
  const bytes = Uint8Array.from(readFileSync(container));
  const before = decoded(bytes);
  compare(before, array);
  // The same by the other decoder of zstd.
  await Promise.all([prepareInflate(), prepareLanes()]);
  assert.deepEqual(decoded(bytes), before);
});

/** Colours and densities of every level. */
function decoded(bytes: Uint8Array): { level: LevelMetadata; number: number; colors: LevelColors }[] {
  const header = readHeader(bytes);
  const entries = readDirectory(header, bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  const laidOut = plan(metadata, { side: 2048, bytes: 2 ** 30, uniforms: 1024 }, 0);
  let coarser: LevelColors | null = null;
  const all = [];
  for (let number = metadata.levels.length - 1; number >= 0; number--) {
    const chunks = levelChunks(entries, number, bytes, 0);
    const decoder = new LevelDecoder(metadata, laidOut, number, chunks, coarser);
    coarser = decoder.colors();
    const level = metadata.levels[number];
    const colors = { ...coarser };
    if (level.density) {
      const atlas = { encoding: level.density, channels: 1, edge: level.block_size, frames: level.blocks_stored, name: "DENS" };
      const { codes } = CODINGS.DENS.decode(atlas, chunks.DENS.bytes, 0, atlas.frames);
      colors.DENS = { level, frames: decoder.blocks.frames, encoding: level.density, codes, channels: 1 };
    }
    all.push({ level, number, colors });
  }
  return all;
}

function compare(levels: ReturnType<typeof decoded>, array: (name: string) => Float32Array): void {
  let compared = 0;
  for (const { level, number, colors } of levels) {
    const [nx, ny, nz] = level.dimensions;
    const [, by, bz] = blockCounts(level);
    const edge = level.block_size;
    for (const [kind, { codes, frames, encoding, channels }] of Object.entries(colors)) {
      const expected = array(`level${number}.${ARRAYS[kind]}`);
      const value = values(encoding, kind, (value) => value);
      for (let node = 0; node < nx * ny * nz; node++) {
        const [x, y, z] = [Math.floor(node / ny / nz), Math.floor(node / nz) % ny, node % nz];
        const frame = frames[(Math.floor(x / edge) * by + Math.floor(y / edge)) * bz + Math.floor(z / edge)];
        if (frame < 0) continue;
        for (let channel = 0; channel < channels; channel++) {
          const inside = ((x % edge) * edge + (y % edge)) * edge + (z % edge);
          const found = value(codes[(frame * channels + channel) * edge ** 3 + inside]);
          const wanted = expected[((BEFORE[kind] ?? 0) + channel) * nx * ny * nz + node];
          if (found !== wanted) assert.fail(`level ${number} ${kind} ${[x, y, z]}: ${found} instead of ${wanted}`);
          compared++;
        }
      }
    }
  }
  assert.ok(compared > 1000, `${compared} values`);
}
