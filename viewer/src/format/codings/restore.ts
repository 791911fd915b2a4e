/**
 * Restores the codes of one block and channel from its residuals, by the rule in section 5 of `formats/mipvog.md`.
 *
 * `restore` computes with 32-bit integers, for codes of one or two bytes. It has one loop for each number of lower
 * neighbours, and masks away the correction of nodes without a residual instead of branching. `restoreWide` is the
 * plain form for any width, in doubles. Both write from `start` on.
 */

/** Data that all channels of a block share. */
export interface Block {
  /** Nodes along each edge. */
  edge: number;
  /** The mean of the first node. */
  origin: number;
  /** The largest code of this width. */
  most: number;
  /** -1 for each node with a residual, else 0. */
  mask: Int32Array;
  /** Index of each node's residual among those of the block; 0 without a residual. */
  rank: Int32Array;
}

/** Codes of one or two bytes. */
export type Narrow = Uint8Array | Uint16Array;

/** Biased residuals; those of a block and channel start at `first`. */
export interface Residuals {
  values: Narrow;
  first: number;
  bias: number;
}

/**
 * Five weights, and the differences of code and mean of the three previous channels. Missing channels have weight 0.
 */
export interface Prediction {
  weights: Int8Array;
  before: readonly [Int32Array, Int32Array, Int32Array];
}

/** Writes codes from `start` on, and their differences from the mean into `own`. */
export function restore(
  { edge: side, origin, most: largest, mask, rank }: Block,
  { values, first: base, bias: zero }: Residuals,
  { weights, before: [d1, d2, d3] }: Prediction,
  codes: Narrow,
  start: number,
  own: Int32Array,
): void {
  // Whole numbers of 32 bits at every step, as `| 0` tells a compiler.
  const [edge, most, bias, first] = [side | 0, largest | 0, zero | 0, base | 0];
  const [w0, w1, w2, w3, w4] = [weights[0] | 0, weights[1] | 0, weights[2] | 0, weights[3] | 0, weights[4] | 0];
  // What the mean takes from a prediction with three lower neighbours.
  const pull = (Math.imul(3, w0) + w1) | 0;
  const dx = Math.imul(edge, edge);
  let node = 0;
  let at = start | 0;
  for (let x = 0; x < edge; x = (x + 1) | 0) {
    for (let y = 0; y < edge; y = (y + 1) | 0) {
      const end = (node + edge) | 0;
      if (x > 0 && y > 0) {
        let up = codes[(at - dx) | 0];
        let back = codes[(at - edge) | 0];
        let corner = codes[(at - dx - edge) | 0];
        let mean = (up + back) >> 1;
        const terms = (Math.imul(w0, (corner - mean) | 0) + (((((Math.imul(w2, d1[node]) + Math.imul(w3, d2[node])) | 0) + Math.imul(w4, d3[node])) | 0) + 16)) | 0;
        let code = (mean + (((terms >> 5) + values[(first + rank[node]) | 0] - bias) & mask[node])) & most;
        codes[at] = code;
        own[node] = (code - mean) | 0;
        for (node = (node + 1) | 0, at = (at + 1) | 0; node < end; node = (node + 1) | 0, at = (at + 1) | 0) {
          // All but the last code, for which each node has to wait.
          let ready = (((Math.imul(w0, (up + back) | 0) + Math.imul(w1, corner)) | 0) + (((((Math.imul(w2, d1[node]) + Math.imul(w3, d2[node])) | 0) + Math.imul(w4, d3[node])) | 0) + 16)) | 0;
          up = codes[(at - dx) | 0];
          back = codes[(at - edge) | 0];
          corner = codes[(at - dx - edge) | 0];
          ready = (ready + Math.imul(w0, corner)) | 0;
          const residual = values[(first + rank[node]) | 0] - bias;
          mean = (((((up + back) | 0) + code) | 0) / 3) | 0;
          code = (mean + ((((ready - Math.imul(pull, mean)) >> 5) + residual) & mask[node])) & most;
          codes[at] = code;
          own[node] = (code - mean) | 0;
        }
      } else if (x > 0 || y > 0) {
        const step = x > 0 ? dx : edge;
        let side = codes[(at - step) | 0];
        let mean = side;
        const terms = ((((((Math.imul(w2, d1[node]) + Math.imul(w3, d2[node])) | 0) + Math.imul(w4, d3[node])) | 0) + 16)) | 0;
        let code = (mean + (((terms >> 5) + values[(first + rank[node]) | 0] - bias) & mask[node])) & most;
        codes[at] = code;
        own[node] = (code - mean) | 0;
        for (node = (node + 1) | 0, at = (at + 1) | 0; node < end; node = (node + 1) | 0, at = (at + 1) | 0) {
          const ready = (Math.imul(w0, side) + (((((Math.imul(w2, d1[node]) + Math.imul(w3, d2[node])) | 0) + Math.imul(w4, d3[node])) | 0) + 16)) | 0;
          const residual = values[(first + rank[node]) | 0] - bias;
          side = codes[(at - step) | 0];
          mean = (side + code) >> 1;
          code = (mean + ((((ready - Math.imul(w0, mean)) >> 5) + residual) & mask[node])) & most;
          codes[at] = code;
          own[node] = (code - mean) | 0;
        }
      } else {
        let mean = origin | 0;
        for (; node < end; node = (node + 1) | 0, at = (at + 1) | 0) {
          const terms = ((((((Math.imul(w2, d1[node]) + Math.imul(w3, d2[node])) | 0) + Math.imul(w4, d3[node])) | 0) + 16)) | 0;
          const code = (mean + (((terms >> 5) + values[(first + rank[node]) | 0] - bias) & mask[node])) & most;
          codes[at] = code;
          own[node] = (code - mean) | 0;
          mean = code;
        }
      }
    }
  }
}

/** As `restore`, in doubles, which can hold sums of codes of up to 4 bytes. */
export function restoreWide(
  { edge, origin, most, mask, rank }: Block,
  { values, first, bias }: { values: Uint8Array | Uint16Array | Float64Array; first: number; bias: number },
  { weights, before }: { weights: Int8Array; before: readonly Float64Array[] },
  codes: Uint8Array | Uint16Array | Uint32Array,
  start: number,
  own: Float64Array,
): void {
  const range = most + 1;
  for (let x = 0, node = 0; x < edge; x++) {
    for (let y = 0; y < edge; y++) {
      for (let z = 0; z < edge; z++, node++) {
        const at = (i: number, j: number, k: number) => codes[start + node - (i * edge + j) * edge - k];
        const lower = [...(x > 0 ? [at(1, 0, 0)] : []), ...(y > 0 ? [at(0, 1, 0)] : []), ...(z > 0 ? [at(0, 0, 1)] : [])];
        const mean = lower.length === 0 ? origin : Math.floor(lower.reduce((sum, code) => sum + code, 0) / lower.length);
        let slopes = 0;
        if (x > 0 && y > 0) slopes += at(1, 1, 0) - mean;
        if (x > 0 && z > 0) slopes += at(1, 0, 1) - mean;
        if (y > 0 && z > 0) slopes += at(0, 1, 1) - mean;
        let terms = weights[0] * slopes + (lower.length === 3 ? weights[1] * (at(1, 1, 1) - mean) : 0);
        before.forEach((differences, i) => (terms += weights[2 + i] * differences[node]));
        const moved = mean + Math.floor((terms + 16) / 32) + values[first + rank[node]] - bias;
        const code = mask[node] ? moved - Math.floor(moved / range) * range : mean;
        codes[start + node] = code;
        own[node] = code - mean;
      }
    }
  }
}
