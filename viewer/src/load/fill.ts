/** The only door to `wasm/bricks.ts`, which makes bricks of codes of one byte. `bricks.ts` is the plain form. */

import module from "../../build/bricks.wasm";
import { instance, places } from "../format/modules.js";
import type { Blocks } from "./blocks.js";
import { type Group, neighbour } from "./bricks.js";

/** Corners of a block: itself, and its upper neighbours. */
const CORNERS = 8;
/** Codes of one byte. */
const CODES = 256;
/** Whole numbers that describe a channel. */
const LANE = 4;

interface Module {
  memory: WebAssembly.Memory;
  densities(blocks: number, edge: number, frames: number, codes: number, table: number, empty: number, zeros: number, out: number): void;
  colors(blocks: number, edge: number, quads: number, frames: number, lanes: number, zeros: number, out: number): void;
}

let filler: Module | null = null;

/** Makes bricks fast where the page and the device allow it; without this, they are as right. */
export async function prepareBricks(): Promise<void> {
  filler = await instance<Module>(module);
}

/** What `densityBricks` makes; null where it has to. */
export function fillDensity(blocks: Blocks, edge: number, range: [number, number], group: Group<Float32Array>): Float32Array | null {
  if (!filler || !areBytes(group)) return null;
  const { memory } = filler;
  const count = range[1] - range[0];
  const texels = count * (edge + 1) ** 3;
  const nodes = edge ** 3;
  const at = places(memory, { frames: 4 * CORNERS * count, codes: group.codes.length, table: 4 * CODES, empty: 4, zeros: nodes, out: 4 * texels });
  putFrames(memory, at.frames, blocks, range);
  putBytes(memory, at.codes, group.codes);
  new Float32Array(memory.buffer, at.table, CODES).set(group.table);
  new Float32Array(memory.buffer, at.empty, 1)[0] = group.empty;
  new Uint8Array(memory.buffer, at.zeros, nodes).fill(0);
  filler.densities(count, edge, at.frames, at.codes - group.first * nodes, at.table, at.empty, at.zeros, at.out);
  return new Float32Array(memory.buffer, at.out, texels).slice();
}

/** What `colorBricks` makes; null where it has to. */
export function fillColors(blocks: Blocks, edge: number, range: [number, number], quads: number, groups: Group<Uint16Array>[]): Uint16Array | null {
  if (!filler || !groups.every(areBytes)) return null;
  const { memory } = filler;
  const count = range[1] - range[0];
  const halves = 4 * count * quads * (edge + 1) ** 3;
  const nodes = edge ** 3;
  const bytes = groups.reduce((sum, { codes }) => sum + codes.length, 0);
  // A table of halves and what is empty for each group, and for channels that there are not.
  const tables = 2 * (CODES + 1);
  const sizes = { frames: 4 * CORNERS * count, codes: bytes, tables: tables * (groups.length + 1), lanes: 4 * LANE * 4 * quads, zeros: nodes, out: 2 * halves };
  const at = places(memory, sizes);
  putFrames(memory, at.frames, blocks, range);
  new Uint8Array(memory.buffer, at.zeros, nodes).fill(0);
  const lanes: number[] = [];
  let codes = at.codes;
  let table = at.tables;
  const begin = (values: ArrayLike<number>, empty: number) => {
    new Uint16Array(memory.buffer, table, CODES + 1).fill(0);
    new Uint16Array(memory.buffer, table, CODES).set(values);
    new Uint16Array(memory.buffer, table + 2 * CODES, 1)[0] = empty;
    table += tables;
    return table - tables;
  };
  for (const group of groups) {
    putBytes(memory, codes, group.codes);
    const values = begin(group.table, group.empty);
    const frame = group.channels * nodes;
    for (let channel = 0; channel < group.channels; channel++) {
      // Absent channels have one block of zeros.
      if (group.codes.length === 0) lanes.push(at.zeros, 0, values, values + 2 * CODES);
      else lanes.push(codes - group.first * frame + channel * nodes, frame, values, values + 2 * CODES);
    }
    codes += group.codes.length;
  }
  const nothing = begin([], 0);
  while (lanes.length < LANE * 4 * quads) lanes.push(at.zeros, 0, nothing, nothing);
  new Int32Array(memory.buffer, at.lanes, lanes.length).set(lanes);
  filler.colors(count, edge, quads, at.frames, at.lanes, at.zeros, at.out);
  return new Uint16Array(memory.buffer, at.out, halves).slice();
}

function areBytes({ codes, table }: Group<Float32Array | Uint16Array>): boolean {
  return codes instanceof Uint8Array && table.length <= CODES;
}

/** The frames of blocks and of their neighbours. */
function putFrames(memory: WebAssembly.Memory, at: number, blocks: Blocks, [from, to]: [number, number]): void {
  const frames = new Int32Array(memory.buffer, at, CORNERS * (to - from));
  let next = 0;
  for (let block = from; block < to; block++) {
    for (let corner = 0; corner < CORNERS; corner++) frames[next++] = neighbour(blocks, block, corner);
  }
}

function putBytes(memory: WebAssembly.Memory, at: number, bytes: ArrayLike<number>): void {
  new Uint8Array(memory.buffer, at, bytes.length).set(bytes);
}
