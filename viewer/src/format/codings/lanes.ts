/** The only door to `wasm/restore.ts`, which restores codes of one byte in vectors of WebAssembly. */

import module from "../../../build/restore.wasm";

/** Blocks that are restored at once. */
const LANES = 8;
/** Vectors of the scratch memory for each node, and bytes of one. */
const [VECTORS, VECTOR] = [8, 16];
/** Where memory is free: what is below is the module's own. */
const FREE = 1 << 16;
const PAGE = 1 << 16;

/** A run as `runs.ts` reads it. */
export interface Run {
  frames: number;
  channels: number;
  edge: number;
  /** Nodes of all frames that have a residual. */
  live: number;
  residuals: Uint8Array;
  /** Of each frame the number of its first residual. */
  starts: Int32Array;
  /** The mode of each frame. */
  modes: Uint8Array;
  /** Five weights of each mode and channel. */
  weights: Int8Array[][];
  /** Which nodes have a residual, whole bytes a frame. */
  bits: Uint8Array;
}

interface Module {
  memory: WebAssembly.Memory;
  restore(frames: number, channels: number, edge: number, live: number, residuals: number, starts: number, modes: number, weights: number, bits: number, scratch: number, out: number): void;
}

let lanes: Module | null = null;

/** Makes restoring fast where the page and the device allow it; without this, it is as right. */
export async function prepareLanes(): Promise<void> {
  try {
    const { instance } = await WebAssembly.instantiate(module);
    lanes = instance.exports as unknown as Module;
  } catch {
    lanes = null;
  }
}

/** Writes all codes of a run; false where WebAssembly may not be used. */
export function restoreLanes({ frames, channels, edge, live, residuals, starts, modes, weights, bits }: Run, codes: Uint8Array): boolean {
  if (!lanes) return false;
  const size = channels * edge ** 3;
  let end = FREE;
  const place = (bytes: number) => {
    const at = end;
    end = Math.ceil((at + bytes) / VECTOR) * VECTOR;
    return at;
  };
  // One residual more is read than there are.
  const at = {
    residuals: place(residuals.length + 1),
    starts: place(4 * frames),
    modes: place(frames),
    weights: place(8 * weights.length * channels),
    bits: place(bits.length),
    scratch: place(VECTORS * VECTOR * edge ** 3 + 8 * VECTOR),
    out: place((frames + LANES - 1) * size),
  };
  const { memory } = lanes;
  const missing = end - memory.buffer.byteLength;
  if (missing > 0) memory.grow(Math.ceil(missing / PAGE));
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
