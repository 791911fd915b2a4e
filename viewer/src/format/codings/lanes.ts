/** The only interface to `wasm/restore.ts`, which restores one-byte codes with WebAssembly vectors. */

import module from "../../../build/restore.wasm";
import { instance, places, VECTOR } from "../modules.js";

/** Number of blocks restored at once. */
const LANES = 8;
/** Scratch vectors per node. */
const VECTORS = 8;

/** A run as read by `runs.ts`. */
export interface Run {
  frames: number;
  channels: number;
  edge: number;
  /** Number of nodes with a residual, over all frames. */
  live: number;
  residuals: Uint8Array;
  /** Index of the first residual of each frame. */
  starts: Int32Array;
  /** Mode of each frame. */
  modes: Uint8Array;
  /** Five weights per mode and channel. */
  weights: Int8Array[][];
  /** Bit mask of nodes with a residual, whole bytes per frame. */
  bits: Uint8Array;
}

interface Module {
  memory: WebAssembly.Memory;
  restore(frames: number, channels: number, edge: number, live: number, residuals: number, starts: number, modes: number, weights: number, bits: number, scratch: number, out: number): void;
}

let lanes: Module | null = null;

/** Makes restoring fast if the page and the device allow WebAssembly; otherwise, the result is the same. */
export async function prepareLanes(): Promise<void> {
  lanes = await instance<Module>(module);
}

/** Writes all codes of a run. Returns false if WebAssembly is not allowed. */
export function restoreLanes({ frames, channels, edge, live, residuals, starts, modes, weights, bits }: Run, codes: Uint8Array): boolean {
  if (!lanes) return false;
  const size = channels * edge ** 3;
  const { memory } = lanes;
  const at = places(memory, {
    // One residual more is read than there are.
    residuals: residuals.length + 1,
    starts: 4 * frames,
    modes: frames,
    weights: 8 * weights.length * channels,
    bits: bits.length,
    scratch: VECTORS * VECTOR * edge ** 3 + 8 * VECTOR,
    out: (frames + LANES - 1) * size,
  });
  const bytes = new Uint8Array(memory.buffer);
  bytes.set(residuals, at.residuals);
  new Int32Array(memory.buffer, at.starts, frames).set(starts);
  bytes.set(modes, at.modes);
  bytes.set(bits, at.bits);
  const table = new Int8Array(memory.buffer);
  weights.flat().forEach((five, number) => table.set(five, at.weights + 8 * number));
  lanes.restore(frames, channels, edge, live, at.residuals, at.starts, at.modes, at.weights, at.bits, at.scratch, at.out);
  codes.set(bytes.subarray(at.out, at.out + frames * size));
  return true;
}
