/**
 * Block data for the device: bricks with one texel per node. Also bricks that mark visible nodes, with aprons, the
 * lowest nodes of the next blocks. In the loops, `Math.imul` and `| 0` keep numbers integers; powers would make them
 * doubles.
 */

import type { Codes } from "../format/codings/index.js";
import type { Blocks } from "./blocks.js";

/** One channel of blocks. */
export interface Lane {
  codes: Codes;
  /** The first block's first code, and the distance from block to block. */
  start: number;
  stride: number;
  /** For each code, the bits of the half float in a texel. */
  table: Uint16Array;
}

/** The codes of one channel of a block; `nothing` for missing channels. */
function codesOf(lane: Lane | null, block: number, nodes: number, nothing: Uint8Array): Codes {
  return lane ? lane.codes.subarray(lane.start + block * lane.stride, lane.start + block * lane.stride + nodes) : nothing;
}

/** The lanes of a quadruple; null for missing channels. */
function four(lanes: (Lane | null)[], quad: number): (Lane | null)[] {
  return [0, 1, 2, 3].map((lane) => lanes[4 * quad + lane] ?? null);
}

/** Bricks of one-byte codes, four channels per texel: the first four lanes block by block, then the next four. */
export function codeBricks(lanes: (Lane | null)[], quads: number, blocks: number, nodes: number): Uint8Array {
  // Four at a time, the first in the lowest byte, as every device with WebGL has it.
  const out = new Uint32Array(quads * blocks * nodes);
  const nothing = new Uint8Array(nodes);
  for (let quad = 0; quad < quads; quad++) {
    const own = four(lanes, quad);
    for (let block = 0; block < blocks; block++) {
      const [a, b, c, d] = own.map((lane) => codesOf(lane, block, nodes, nothing) as Uint8Array);
      interleave(a, b, c, d, out, (quad * blocks + block) * nodes, nodes);
    }
  }
  return new Uint8Array(out.buffer);
}

function interleave(a: Uint8Array, b: Uint8Array, c: Uint8Array, d: Uint8Array, out: Uint32Array, start: number, nodes: number): void {
  for (let node = 0, at = start | 0; node < nodes; node = (node + 1) | 0, at = (at + 1) | 0) out[at] = a[node] | (b[node] << 8) | (c[node] << 16) | (d[node] << 24);
}

/** As `codeBricks`, with half floats, from codes of any width. */
export function halfBricks(lanes: (Lane | null)[], quads: number, blocks: number, nodes: number): Uint16Array {
  const out = new Uint32Array(2 * quads * blocks * nodes);
  const [nothing, zero] = [new Uint8Array(nodes), Uint16Array.of(0)];
  let at = 0;
  for (let quad = 0; quad < quads; quad++) {
    const own = four(lanes, quad);
    const [ta, tb, tc, td] = own.map((lane) => lane?.table ?? zero);
    for (let block = 0; block < blocks; block++) {
      const [a, b, c, d] = own.map((lane) => codesOf(lane, block, nodes, nothing));
      for (let node = 0; node < nodes; node = (node + 1) | 0, at = (at + 2) | 0) {
        out[at] = ta[a[node]] | (tb[b[node]] << 16);
        out[at + 1] = tc[c[node]] | (td[d[node]] << 16);
      }
    }
  }
  return new Uint16Array(out.buffer);
}

/**
 * Codes of density of the frames from `first` on; for each code, whether it can be visible, and whether empty space
 * can.
 */
export interface Seen {
  codes: Codes;
  first: number;
  table: Uint8Array;
  empty: 0 | 1;
}

/** The blocks `[from, to)` with their aprons: 1 for nodes that can be visible. */
export function seenBricks(blocks: Blocks, edge: number, [from, to]: [number, number], { codes, first, table, empty }: Seen): Uint8Array {
  const out = new Uint8Array((to - from) * (edge + 1) ** 3);
  const nodes = edge * edge * edge;
  const [none, always] = [new Uint8Array(nodes), Uint8Array.of(empty)];
  for (let block = from; block < to; block++) {
    for (let corner = 0; corner < 8; corner++) {
      const frame = neighbour(blocks, block, corner);
      const [x, y, z] = [corner >> 2, (corner >> 1) & 1, corner & 1];
      const side = edge + 1;
      const counts = [x ? 1 : edge, y ? 1 : edge, z ? 1 : edge] as const;
      const start = (block - from) * side * side * side + ((x * side + y) * side + z) * edge;
      if (frame < 0) put(edge, counts, start, none, 0, always, out);
      else put(edge, counts, start, codes, (frame - first) * nodes, table, out);
    }
  }
  return out;
}

/** The frame of a block, or of its neighbour along each axis whose bit is set. */
function neighbour(blocks: Blocks, block: number, corner: number): number {
  const [x, y, z] = blocks.places[block];
  return blocks.frame(x + (corner >> 2), y + ((corner >> 1) & 1), z + (corner & 1));
}

function put(edge: number, [cx, cy, cz]: readonly [number, number, number], start: number, codes: Codes, at: number, table: Uint8Array, out: Uint8Array): void {
  for (let x = 0; x < cx; x++) {
    for (let y = 0; y < cy; y++) {
      let texel = (start + Math.imul(Math.imul(x, edge + 1) + y, edge + 1)) | 0;
      let node = (at + Math.imul(Math.imul(x, edge) + y, edge)) | 0;
      for (const end = (node + cz) | 0; node < end; node = (node + 1) | 0, texel = (texel + 1) | 0) out[texel] = table[codes[node]];
    }
  }
}
