/** Runs of residuals, each a zstd frame: section 5 of `formats/mipvog.md`. */

import { FieldError } from "../../errors.js";
import { contentSize, inflate } from "../zstd.js";
import type { Atlas, Codes, Coding } from "./atlas.js";

const STORED = 0x80000000;
/** Channels before one that its predictions look at. */
const BEFORE = 3;

/** Bytes of a code, and the mean of a block's first node. */
const WIDTHS = {
  u8: { bytes: 1, origin: 0 },
  u16: { bytes: 2, origin: 0 },
  f16: { bytes: 2, origin: 0x8000 },
  f32: { bytes: 4, origin: 0x80000000 },
} as const;

export const decodeRuns: Coding = (atlas, chunk) => {
  const width = WIDTHS[atlas.encoding.number].bytes;
  const size = atlas.channels * atlas.edge ** 3;
  const count = atlas.frames * size;
  const codes: Codes = width === 1 ? new Uint8Array(count) : width === 2 ? new Uint16Array(count) : new Uint32Array(count);
  let frame = 0;
  for (const { bytes, frames, stored } of runs(atlas, chunk)) {
    decodeRun(atlas, stored ? bytes : inflateRun(atlas, frames, bytes), frames, codes.subarray(frame * size, (frame + frames) * size));
    frame += frames;
  }
  check(atlas, codes);
  return codes;
};

/** The runs of a chunk, in order. */
function* runs(atlas: Atlas, chunk: Uint8Array): Generator<{ bytes: Uint8Array; frames: number; stored: boolean }> {
  const wrong = () => new FieldError(`${atlas.name} does not hold the runs of ${atlas.frames} blocks.`);
  if (chunk.length < 8) throw wrong();
  const data = new DataView(chunk.buffer, chunk.byteOffset, chunk.byteLength);
  const [full, count] = [data.getUint32(0, true), data.getUint32(4, true)];
  if (full === 0 || count !== Math.ceil(atlas.frames / full) || chunk.length < 8 + 4 * count) throw wrong();
  let at = 8 + 4 * count;
  for (let run = 0; run < count; run++) {
    const word = data.getUint32(8 + 4 * run, true);
    const bytes = chunk.subarray(at, at + (word & ~STORED));
    at += word & ~STORED;
    if (at > chunk.length) throw wrong();
    yield { bytes, frames: Math.min(full, atlas.frames - run * full), stored: word >= STORED };
  }
  if (at !== chunk.length) throw wrong();
}

function inflateRun(atlas: Atlas, frames: number, bytes: Uint8Array): Uint8Array {
  const { channels, edge, encoding } = atlas;
  const size = contentSize(bytes);
  const most = 1 + 255 * 5 * channels + frames * (1 + edge ** 3 * (1 + channels * WIDTHS[encoding.number].bytes));
  if (size === null || !(size <= most)) throw new FieldError(`${atlas.name} has a run that states no length, or one beyond its blocks.`);
  return inflate(bytes, size, atlas.name);
}

/** Weights of a channel's predictions. */
function terms(channel: number): number {
  return 2 + Math.min(channel, BEFORE);
}

/** The codes of a run: frame by frame, channel by channel. */
function decodeRun(atlas: Atlas, run: Uint8Array, frames: number, codes: Codes): void {
  const { channels, edge } = atlas;
  const { bytes: width, origin } = WIDTHS[atlas.encoding.number];
  const nodes = edge ** 3;
  let at = 0;
  const take = (count: number) => {
    at += count;
    if (at > run.length) throw new FieldError(`${atlas.name} has a run of ${run.length} bytes, which is too short.`);
    return run.subarray(at - count, at);
  };
  const wrong = (what: string) => new FieldError(`${atlas.name} has a run with ${what}.`);
  const [modes] = take(1);
  if (modes === 0) throw wrong("no modes");
  const weights = Array.from({ length: modes }, () =>
    Array.from({ length: channels }, (_, channel) => Int8Array.from([...Int8Array.from(take(terms(channel))), 0, 0, 0]).subarray(0, 5)),
  );
  const modeOf = take(frames);
  const liveBytes = Math.ceil(nodes / 8);
  const bits = take(frames * liveBytes);
  // Where each frame's residuals start among those of a channel's byte: in the order of modes.
  const starts = new Array<number>(frames);
  let live = 0;
  for (let mode = 0; mode < modes; mode++) {
    for (let frame = 0; frame < frames; frame++) {
      if (modeOf[frame] !== mode) continue;
      starts[frame] = live;
      for (let byte = 0; byte < liveBytes; byte++) live += ones(bits[frame * liveBytes + byte]);
    }
  }
  for (let frame = 0; frame < frames; frame++) {
    if (modeOf[frame] >= modes) throw wrong("a mode that it does not have");
    if (nodes % 8 > 0 && bits[(frame + 1) * liveBytes - 1] >> (nodes % 8) !== 0) throw wrong("bits of nodes that no block has");
  }
  const residuals = take(live * channels * width);
  if (at !== run.length) throw wrong("bytes after its residuals");
  // Differences of code and mean of the channels so far, by their number modulo 4.
  const differences = Array.from({ length: BEFORE + 1 }, () => new Float64Array(nodes));
  for (let frame = 0; frame < frames; frame++) {
    const from = bits.subarray(frame * liveBytes, (frame + 1) * liveBytes);
    for (let channel = 0; channel < channels; channel++) {
      const first = (frame * channels + channel) * nodes;
      restore(
        { edge, width, origin, live: from, weights: weights[modeOf[frame]][channel] },
        residuals.subarray(channel * width * live + starts[frame]),
        live,
        [0, 1, 2, 3].map((before) => differences[(channel - before + 4) % 4]),
        Math.min(channel, BEFORE),
        codes.subarray(first, first + nodes),
      );
    }
  }
}

function ones(byte: number): number {
  let count = 0;
  for (let left = byte; left > 0; left &= left - 1) count++;
  return count;
}

interface Rule {
  edge: number;
  width: number;
  origin: number;
  /** A bit for each node: whether it has a residual. */
  live: Uint8Array;
  weights: Int8Array;
}

/**
 * The codes of one block and channel. `differences` are those of this channel, which are written, and of the ones before
 * it, of which there are `before`. The bytes of a residual lie `stride` apart. Numbers of up to 43 bits are exact in doubles.
 */
function restore(
  { edge, width, origin, live, weights }: Rule,
  residuals: Uint8Array,
  stride: number,
  differences: Float64Array[],
  before: number,
  codes: Codes,
): void {
  const [dx, dy] = [edge * edge, edge];
  const [own, first, second, third] = differences;
  const [w0, w1, w2, w3, w4] = weights;
  const range = 256 ** width;
  const bias = 0x80 * ((range - 1) / 255);
  let node = 0;
  let next = 0;
  for (let x = 0; x < edge; x++) {
    for (let y = 0; y < edge; y++) {
      for (let z = 0; z < edge; z++, node++) {
        let sum = 0;
        let neighbours = 0;
        if (x > 0) (sum += codes[node - dx]), neighbours++;
        if (y > 0) (sum += codes[node - dy]), neighbours++;
        if (z > 0) (sum += codes[node - 1]), neighbours++;
        const mean = neighbours === 0 ? origin : Math.floor(sum / neighbours);
        let code = mean;
        if ((live[node >> 3] >> (node & 7)) & 1) {
          let slopes = 0;
          if (x > 0 && y > 0) slopes += codes[node - dx - dy] - mean;
          if (x > 0 && z > 0) slopes += codes[node - dx - 1] - mean;
          if (y > 0 && z > 0) slopes += codes[node - dy - 1] - mean;
          let terms = w0 * slopes;
          if (neighbours === 3) terms += w1 * (codes[node - dx - dy - 1] - mean);
          if (before > 0) terms += w2 * first[node];
          if (before > 1) terms += w3 * second[node];
          if (before > 2) terms += w4 * third[node];
          let residual = residuals[next];
          for (let byte = 1; byte < width; byte++) residual += residuals[next + byte * stride] * 256 ** byte;
          next++;
          code = mean + Math.floor((terms + 16) / 32) + residual - bias;
          code -= Math.floor(code / range) * range;
        }
        codes[node] = code;
        own[node] = code - mean;
      }
    }
  }
}

/** Codes within the bits that the metadata states; floats that are numbers. */
function check(atlas: Atlas, codes: Codes): void {
  const { number, bits } = atlas.encoding;
  const wrong = (code: number) => new FieldError(`${atlas.name} holds the code ${code}, which ${number} of ${bits} bits cannot be.`);
  if (number === "u8" || number === "u16") {
    const most = 2 ** bits - 1;
    for (const code of codes) if (code > most) throw wrong(code);
    return;
  }
  // Ordered bits of infinities and NaNs lie at both ends.
  const [least, most] = number === "f16" ? [0x0400, 0xfbff] : [0x00800000, 0xff7fffff];
  for (const code of codes) if (code < least || code > most) throw wrong(code);
}
