/** What the device gets of nodes means, decoded as shaders do, what the file says; and it is not many times the file. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { type Codes, CODINGS } from "../src/format/codings/index.js";
import { values } from "../src/format/codings/values.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { type Encoding, hasLevels, readMetadata, storedGroups } from "../src/format/metadata.js";
import { partsOf } from "../src/format/parts.js";
import { interpolatedDensity } from "../src/load/interpolated.js";
import { levelChunks, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { decoding, isDirectional, storedCodes, texelOf } from "../src/load/texels.js";
import { ROOT } from "./support.js";

const DEVICE = { side: 2048, bytes: 2 ** 31, uniforms: 1024 };
/** Without inherited blocks: of each kind of texels, with one group of colours and with several, and with shells. */
const NAMES = ["tiny.rate", "tiny.12bit", "tiny.rate.f16", "tiny.isotropic", "dvgo.f32", "dvgo.f16", "harmonics", "harmonics.f16", "linear", "boxes"];
/** A value is held in halves at the coarsest: 11 bits of it. */
const HALF = 2 ** -11;
/** Textures of containers of 8 bits are at most so many times the file, where its codes themselves are less than five times it. */
const [MOST_TIMES, MOST_CODES] = [6, 5];

function read(name: string) {
  const bytes = Uint8Array.from(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
  const entries = readDirectory(readHeader(bytes), bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  return { bytes, entries, metadata, laidOut: plan(metadata, DEVICE, 0) };
}

/** The number that binary16 bits are. */
function ofHalf(bits: number): number {
  const [sign, exponent, fraction] = [bits & 0x8000 ? -1 : 1, (bits >> 10) & 31, bits & 1023];
  return sign * (exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25));
}

/** What a shader has of a texel's channel: bytes as numbers from 0 to 1. */
function fetched(bricks: Uint8Array | Uint16Array | Float32Array, at: number): number {
  return bricks instanceof Uint8Array ? bricks[at] / 255 : bricks instanceof Uint16Array ? ofHalf(bricks[at]) : bricks[at];
}

function decoded(t: number, [center, step, curve, middle]: number[], empty: number): number {
  if (middle < 0 && t === 0) return empty;
  const x = t - Math.abs(middle);
  return center + x * (step + curve * x * x);
}

for (const name of NAMES) {
  test(`texels of ${name} mean what the file says`, () => {
    const { bytes, entries, metadata, laidOut } = read(name);
    let compared = 0;
    partsOf(metadata).forEach(({ blocks_stored: blocks, block_size: edge }, part) => {
      if (blocks === 0) return;
      const chunks = levelChunks(entries, part, bytes, 0, metadata.levels.length);
      const decoder = new LevelDecoder(metadata, laidOut, part, chunks, null);
      const [bricks] = decoder.parts(0, blocks);
      const nodes = edge ** 3;
      /** The first channel of a group in its bricks, which have several where there are quadruples. */
      let [next, beside] = [0, hasLevels(metadata, "anisotropy") ? 5 : 0];
      for (const { kind, encoding, channels } of storedGroups(metadata, part)) {
        const codes: Codes = CODINGS[kind].decode({ encoding, channels, edge, frames: blocks, name: kind }, chunks[kind].bytes, 0, blocks).codes;
        const map = kind === "DENS" ? interpolatedDensity(metadata.activation, encoding.decode) : (value: number) => value;
        const value = values(encoding, kind, map);
        const rule = decoding(texelOf(laidOut.texels, kind), encoding as Encoding);
        const isBeside = kind === "DENS" && laidOut.texels.density === "beside";
        const [own, quads] = isDirectional(kind) ? [bricks.directional!, laidOut.directionalQuads] : kind === "DENS" && !isBeside ? [bricks.density!, 1] : [bricks.color, laidOut.quads];
        const width = own === bricks.density ? 1 : 4;
        const first = isBeside ? 4 * quads - 1 : kind === "ANIS" ? 0 : kind === "DIRB" ? beside : kind === "DENS" ? 0 : next;
        if (!isDirectional(kind) && kind !== "DENS") next += channels;
        for (let block = 0; block < blocks; block++) {
          for (let channel = 0; channel < channels; channel++) {
            for (let node = 0; node < nodes; node++) {
              const quad = Math.floor((first + channel) / width);
              const at = ((quad * blocks + block) * nodes + node) * width + ((first + channel) % width);
              const wanted = value(codes[(block * channels + channel) * nodes + node]);
              const found = decoded(fetched(own, at), rule, map(encoding.empty));
              const off = Math.abs(found - wanted);
              if (off > HALF * Math.abs(wanted) + 1e-6 * Math.max(1, Math.abs(wanted))) assert.fail(`part ${part} ${kind}, block ${block}, channel ${channel}, node ${node}: ${found} instead of ${wanted}`);
              compared++;
            }
          }
        }
      }
    });
    assert.ok(compared > 1000, `${compared} values`);
  });
}

test("textures take at most six times the bytes of files whose codes take less than five", () => {
  const names = ["tiny.rate", "tiny.code", "tiny.paper", "tiny.isotropic", "tiny.rate.error", "tiny.fit.filled", "tiny.12bit", "linear", "world", "boxes.deep", "boxes.filled", "dvgo.mask"];
  for (const name of names) {
    const { bytes, metadata, laidOut } = read(name);
    const codes = storedCodes(metadata);
    assert.ok(codes < MOST_CODES * bytes.length, `${name}: codes of ${codes} bytes`);
    assert.ok(laidOut.bytes <= MOST_TIMES * bytes.length, `${name}: ${laidOut.bytes} bytes for ${bytes.length}`);
  }
});
