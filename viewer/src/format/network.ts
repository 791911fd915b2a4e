/** The view-dependent network, chunk VMLP. */

import { FieldError } from "../errors.js";
import type { NetworkShape } from "./metadata.js";

export interface Layer {
  inputs: number;
  outputs: number;
  /** `[outputs, inputs]` in C order. */
  weights: Float32Array;
  biases: Float32Array;
}

/** Reads chunk VMLP. */
export function readNetwork(view: NetworkShape, bytes: Uint8Array): Layer[] {
  const layers: Layer[] = [];
  let at = 0;
  const floats = (count: number) => {
    if (at + 4 * count > bytes.length) throw new FieldError("Chunk VMLP ends within its weights.");
    const read = new Float32Array(bytes.slice(at, at + 4 * count).buffer);
    at += 4 * count;
    if (!read.every(Number.isFinite)) throw new FieldError("The network has a weight that is not finite.");
    return read;
  };
  for (let i = 0; i + 1 < view.widths.length; i++) {
    const [inputs, outputs] = [view.widths[i], view.widths[i + 1]];
    layers.push({ inputs, outputs, weights: floats(inputs * outputs), biases: floats(outputs) });
  }
  if (at !== bytes.length) throw new FieldError("Chunk VMLP has bytes after its last layer.");
  return layers;
}
