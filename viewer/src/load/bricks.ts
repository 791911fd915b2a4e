/**
 * Bricks: blocks with aprons, the lowest nodes of the next blocks, `empty` where the next is not stored.
 * In the loops `Math.imul` and `| 0` keep numbers whole; powers would make them doubles.
 */

import type { Blocks } from "./blocks.js";

/** Codes of the frames from `first` on: frame by frame, channel by channel, nodes in C order; and what the device gets. */
export interface Group<T extends Float32Array | Uint16Array> {
  codes: Uint8Array | Uint16Array | Uint32Array;
  first: number;
  channels: number;
  /** By code, what is written. */
  table: T;
  /** What is written for blocks that are not stored. */
  empty: number;
}

/** Channels that a level does not have: zeros. */
export function absent(channels: number): Group<Uint16Array> {
  return { codes: new Uint8Array(0), first: 0, channels, table: Uint16Array.of(0), empty: 0 };
}

/** A box of nodes of a block, and where it goes in a brick. */
interface Part {
  edge: number;
  /** Nodes along each axis. */
  counts: readonly [number, number, number];
  /** The first texel. */
  start: number;
}

/** Values of one channel of a block: `table` of codes from `at` on. */
interface Lane<T> {
  codes: Uint8Array | Uint16Array | Uint32Array;
  at: number;
  table: T;
}

/** Densities of the blocks `[from, to)`, one value a texel. */
export function densityBricks(blocks: Blocks, edge: number, [from, to]: [number, number], group: Group<Float32Array>): Float32Array {
  const out = new Float32Array((to - from) * (edge + 1) ** 3);
  const { codes, table, first } = group;
  const nodes = edge * edge * edge;
  const nothing = { codes: new Uint8Array(edge ** 3), at: 0, table: Float32Array.of(group.empty) };
  for (let block = from; block < to; block++) {
    for (let corner = 0; corner < 8; corner++) {
      const frame = neighbour(blocks, block, corner);
      put(part(edge, block - from, corner), frame < 0 ? nothing : { codes, at: (frame - first) * nodes, table }, out);
    }
  }
  return out;
}

/** Colours of the blocks `[from, to)`, in `quads` rows of bricks, one a block, with four channels a texel in halves. */
export function colorBricks(blocks: Blocks, edge: number, [from, to]: [number, number], quads: number, groups: Group<Uint16Array>[]): Uint16Array {
  // Two halves at a time, the first in the lower one, as every device with WebGL has it.
  const out = new Uint32Array((to - from) * quads * (edge + 1) ** 3 * 2);
  const nodes = edge * edge * edge;
  const none = { codes: new Uint8Array(nodes), at: 0, table: Uint16Array.of(0) };
  const lanes = groups.flatMap((group) => Array.from({ length: group.channels }, (_, channel) => ({ group, channel, nothing: { ...none, table: Uint16Array.of(group.empty) } })));
  const lane = (number: number, frame: number): Lane<Uint16Array> => {
    if (number >= lanes.length) return none;
    const { group, channel, nothing } = lanes[number];
    const { codes, table, first, channels } = group;
    return frame < 0 || codes.length === 0 ? nothing : { codes, at: ((frame - first) * channels + channel) * nodes, table };
  };
  for (let block = from; block < to; block++) {
    for (let corner = 0; corner < 8; corner++) {
      const frame = neighbour(blocks, block, corner);
      for (let pair = 0; pair < 2 * quads; pair++) {
        const brick = (pair >> 1) * (to - from) + block - from;
        putPair(part(edge, brick, corner), lane(2 * pair, frame), lane(2 * pair + 1, frame), out, pair & 1);
      }
    }
  }
  return new Uint16Array(out.buffer);
}

/** The frame of a block, or of its next one along each axis whose bit is set. */
export function neighbour(blocks: Blocks, block: number, corner: number): number {
  const [x, y, z] = blocks.places[block];
  return blocks.frame(x + (corner >> 2), y + ((corner >> 1) & 1), z + (corner & 1));
}

/** The block itself, or of its next one the lowest nodes along each axis whose bit is set. */
function part(edge: number, brick: number, corner: number): Part {
  const [x, y, z] = [corner >> 2, (corner >> 1) & 1, corner & 1];
  const side = edge + 1;
  return { edge, counts: [x ? 1 : edge, y ? 1 : edge, z ? 1 : edge], start: brick * side * side * side + ((x * side + y) * side + z) * edge };
}

function put({ edge, counts, start }: Part, { codes, at, table }: Lane<Float32Array>, out: Float32Array): void {
  const [cx, cy, cz] = counts;
  for (let x = 0; x < cx; x++) {
    for (let y = 0; y < cy; y++) {
      let texel = (start + Math.imul(Math.imul(x, edge + 1) + y, edge + 1)) | 0;
      let node = (at + Math.imul(Math.imul(x, edge) + y, edge)) | 0;
      for (const end = (node + cz) | 0; node < end; node = (node + 1) | 0, texel = (texel + 1) | 0) out[texel] = table[codes[node]];
    }
  }
}

/** Writes two channels of four: the first or the second pair. */
function putPair({ edge, counts, start }: Part, a: Lane<Uint16Array>, b: Lane<Uint16Array>, out: Uint32Array, pair: number): void {
  const [cx, cy, cz] = counts;
  const { codes: aCodes, table: aTable, at: aStart } = a;
  const { codes: bCodes, table: bTable, at: bStart } = b;
  for (let x = 0; x < cx; x++) {
    for (let y = 0; y < cy; y++) {
      let at = (2 * (start + Math.imul(Math.imul(x, edge + 1) + y, edge + 1)) + pair) | 0;
      const row = Math.imul(Math.imul(x, edge) + y, edge);
      let i = (aStart + row) | 0;
      let j = (bStart + row) | 0;
      for (const end = (i + cz) | 0; i < end; i = (i + 1) | 0, j = (j + 1) | 0, at = (at + 2) | 0) {
        out[at] = aTable[aCodes[i]] | (bTable[bCodes[j]] << 16);
      }
    }
  }
}
