/** The only door to `wasm/skip.ts`, which finds distances 16 cells at a time. `skip.ts` has the plain form. */

import module from "../../build/skip.wasm";
import type { Triple } from "../format/metadata.js";
import { instance, places } from "../format/modules.js";

interface Module {
  memory: WebAssembly.Memory;
  distances(cells: number, nx: number, ny: number, nz: number, scratch: number): void;
  scratchBytes(ny: number, nz: number): number;
}

let sweeper: Module | null = null;

/** Makes skip distances fast where the page and the device allow it; without this, they are as right. */
export async function prepareSweeps(): Promise<void> {
  sweeper = await instance<Module>(module);
}

/** What `sweepBoth` does; false where WebAssembly may not be used. */
export function sweepLanes(cells: Uint8Array, [nx, ny, nz]: Triple): boolean {
  if (!sweeper) return false;
  const { memory } = sweeper;
  const at = places(memory, { cells: cells.length, scratch: sweeper.scratchBytes(ny, nz) });
  new Uint8Array(memory.buffer, at.cells, cells.length).set(cells);
  sweeper.distances(at.cells, nx, ny, nz, at.scratch);
  cells.set(new Uint8Array(memory.buffer, at.cells, cells.length));
  return true;
}
