/** The free-space mask, chunk MASK. */

import { FieldError, REMEDY } from "../errors.js";
import type { Triple } from "./metadata.js";
import { inflate } from "./zstd.js";

export interface Mask {
  lookup: "nearest" | "trilinear";
  nodes: Triple;
  /** A world position `p` is at `p * scale + shift` in the mask's index space. */
  scale: Triple;
  shift: Triple;
  /** Trilinear masks: positions with at least this value are inside. */
  threshold: number;
  /** Values, z fastest. Bytes with 255 for 1 if all values are 0 or 1, as in nearest masks. */
  values: Float32Array | Uint8Array;
}

/** Maximum number of nodes of a mask, which is coarse and entirely in memory. */
const MOST_NODES = 2 ** 26;

/** Reads chunk MASK. */
export function readMask(bytes: Uint8Array): Mask {
  if (bytes.length < 72) throw new FieldError("Chunk MASK ends within its header.");
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const doubles = (at: number) => [0, 8, 16].map((i) => data.getFloat64(at + i, true)) as Triple;
  const lookup = data.getUint32(0, true);
  if (lookup > 1) throw new FieldError(`The free-space mask has lookup ${lookup}; this viewer knows 0 and 1.`, REMEDY.newer);
  const nodes = [4, 8, 12].map((at) => data.getUint32(at, true)) as Triple;
  const count = nodes[0] * nodes[1] * nodes[2];
  if (nodes.some((n) => n < 2) || count > MOST_NODES) throw new FieldError(`The free-space mask has ${nodes.join(" x ")} nodes.`);
  const [scale, shift, threshold] = [doubles(16), doubles(40), data.getFloat32(64, true)];
  if (![...scale, ...shift, threshold].every(Number.isFinite)) throw new FieldError("The free-space mask has a number that is not finite.");
  // Also -0 is a threshold: its bits are not zero.
  if (lookup === 0 && data.getUint32(64, true) !== 0) throw new FieldError("The free-space mask has a threshold beside a nearest lookup.");
  if (data.getUint32(68, true) !== 0) throw new FieldError("The free-space mask has a reserved byte that is set.");
  const inflated = inflate(bytes.subarray(72), count * (lookup ? 4 : 1), "Chunk MASK");
  const values = lookup ? new Float32Array(inflated.buffer) : Float32Array.from(inflated);
  if (!values.every((value) => (lookup ? Number.isFinite(value) : value === 0 || value === 1))) {
    throw new FieldError("The free-space mask has a value that cannot be.");
  }
  const isBinary = values.every((value) => value === 0 || value === 1);
  return { lookup: lookup ? "trilinear" : "nearest", nodes, scale, shift, threshold, values: isBinary ? Uint8Array.from(values, (value) => 255 * value) : values };
}
