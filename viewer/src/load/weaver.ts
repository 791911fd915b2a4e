/**
 * The only interface to `wasm/weave.ts`, which makes bricks of one-byte codes. `codeBricks` of `bricks.ts` is the plain
 * form.
 */

import module from "../../build/weave.wasm";
import type { Codes } from "../format/codings/index.js";
import { instance, places } from "../format/modules.js";
import type { Lane } from "./bricks.js";

interface Module {
  memory: WebAssembly.Memory;
  weave(blocks: number, nodes: number, lanes: number, out: number): void;
}

let weaver: Module | null = null;

/** Makes bricks fast if the page and the device allow WebAssembly; otherwise, the result is the same. */
export async function prepareWeaver(): Promise<void> {
  weaver = await instance<Module>(module);
}

/** As `codeBricks`; null if WebAssembly is not allowed. */
export function weaveBricks(lanes: (Lane | null)[], quads: number, blocks: number, nodes: number): Uint8Array | null {
  if (!weaver) return null;
  const { memory } = weaver;
  const all = new Map<Codes, number>();
  for (const lane of lanes) if (lane) all.set(lane.codes, 0);
  const bytes = [...all.keys()].reduce((sum, { length }) => sum + length, 0);
  const at = places(memory, { codes: bytes, nothing: nodes, lanes: 4 * 2 * 4 * quads, out: 4 * quads * blocks * nodes });
  let next = at.codes;
  for (const codes of all.keys()) {
    new Uint8Array(memory.buffer, next, codes.length).set(codes);
    all.set(codes, next);
    next += codes.length;
  }
  new Uint8Array(memory.buffer, at.nothing, nodes).fill(0);
  const numbers = Array.from({ length: 4 * quads }, (_, number) => lanes[number] ?? null).flatMap((lane) => (lane ? [all.get(lane.codes)! + lane.start, lane.stride] : [at.nothing, 0]));
  new Int32Array(memory.buffer, at.lanes, numbers.length).set(numbers);
  for (let quad = 0; quad < quads; quad++) weaver.weave(blocks, nodes, at.lanes + 32 * quad, at.out + 4 * quad * blocks * nodes);
  return new Uint8Array(memory.buffer, at.out, 4 * quads * blocks * nodes).slice();
}
