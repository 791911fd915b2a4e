/** The only interface to `wasm/skip.ts`, which computes distances 16 cells at a time. `skip.ts` has the plain form. */

import module from "../../build/skip.wasm";
import type { Triple } from "../format/metadata.js";
import { instance, places } from "../format/modules.js";

interface Module {
  memory: WebAssembly.Memory;
  distances(cells: number, nx: number, ny: number, nz: number, scratch: number): void;
  scratchBytes(ny: number, nz: number): number;
}

let sweeper: Module | null = null;

/** Makes skip distances fast if the page and the device allow WebAssembly; otherwise, the result is the same. */
export async function prepareSweeps(): Promise<void> {
  sweeper = await instance<Module>(module);
}

/** As `sweepBoth`. Returns false if WebAssembly is not allowed. */
export function sweepLanes(cells: Uint8Array, [nx, ny, nz]: Triple): boolean {
  if (!sweeper) return false;
  const { memory } = sweeper;
  const at = places(memory, { cells: cells.length, scratch: sweeper.scratchBytes(ny, nz) });
  new Uint8Array(memory.buffer, at.cells, cells.length).set(cells);
  sweeper.distances(at.cells, nx, ny, nz, at.scratch);
  cells.set(new Uint8Array(memory.buffer, at.cells, cells.length));
  return true;
}
