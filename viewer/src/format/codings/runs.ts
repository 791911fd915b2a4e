/** Runs of residuals, each a zstd frame: section 5 of `formats/mipvog.md`. */

import { FieldError } from "../../errors.js";
import { contentSize, inflate } from "../zstd.js";
import type { Atlas, Codes, Coding } from "./atlas.js";
import { restoreLanes } from "./lanes.js";
import { restore, restoreWide } from "./restore.js";

const STORED = 0x80000000;
/** Number of previous channels that predictions use. */
const BEFORE = 3;

/** By width: bytes per code, the mean of a block's first node, the largest code, and the bias of residuals. */
const WIDTHS = {
  u8: { bytes: 1, origin: 0, most: 0xff, bias: 0x80 },
  u16: { bytes: 2, origin: 0, most: 0xffff, bias: 0x8080 },
  f16: { bytes: 2, origin: 0x8000, most: 0xffff, bias: 0x8080 },
  f32: { bytes: 4, origin: 0x80000000, most: 0xffffffff, bias: 0x80808080 },
} as const;

export const runCoding: Coding = { decode, share };

function decode(atlas: Atlas, chunk: Uint8Array, from: number, to: number): { first: number; codes: Codes } {
  const width = WIDTHS[atlas.encoding.number].bytes;
  const size = atlas.channels * atlas.edge * atlas.edge * atlas.edge;
  const { full, runs } = runsOf(atlas, chunk);
  const wanted = from < to ? runs.slice(Math.floor(from / full), Math.ceil(to / full)) : [];
  const first = wanted[0]?.frame ?? from;
  const count = wanted.reduce((sum, { frames }) => sum + frames, 0) * size;
  const codes: Codes = width === 1 ? new Uint8Array(count) : width === 2 ? new Uint16Array(count) : new Uint32Array(count);
  for (const { bytes, frame, frames, stored } of wanted) {
    const inflated = stored ? bytes : inflateRun(atlas, frames, bytes);
    decodeRun(atlas, inflated, frames, codes.subarray((frame - first) * size, (frame - first + frames) * size));
  }
  check(atlas, codes);
  return { first, codes };
}

/** Keeps the runs of the requested frames and empties the others, so that frame numbers do not change. */
function share(atlas: Atlas, chunk: Uint8Array, from: number, to: number): Uint8Array {
  const { runs } = runsOf(atlas, chunk);
  const isWanted = ({ frame, frames }: StoredRun) => frame < to && from < frame + frames;
  const head = 8 + 4 * runs.length;
  const out = new Uint8Array(head + runs.filter(isWanted).reduce((sum, { bytes }) => sum + bytes.length, 0));
  out.set(chunk.subarray(0, head));
  const data = new DataView(out.buffer);
  let at = head;
  runs.forEach((run, number) => {
    if (isWanted(run)) {
      out.set(run.bytes, at);
      at += run.bytes.length;
    } else {
      data.setUint32(8 + 4 * number, 0, true);
    }
  });
  return out;
}

interface StoredRun {
  bytes: Uint8Array;
  /** Index of the first frame. */
  frame: number;
  frames: number;
  stored: boolean;
}

/** The runs of a chunk, in order, and the number of frames in each but the last. */
interface Runs {
  full: number;
  runs: StoredRun[];
}

/** Runs of chunks that are decoded part by part. */
const known = new WeakMap<Uint8Array, Runs>();

function runsOf(atlas: Atlas, chunk: Uint8Array): Runs {
  let found = known.get(chunk);
  if (!found) known.set(chunk, (found = findRuns(atlas, chunk)));
  return found;
}

function findRuns(atlas: Atlas, chunk: Uint8Array): Runs {
  const wrong = () => new FieldError(`${atlas.name} does not hold the runs of ${atlas.frames} blocks.`);
  if (chunk.length < 8) throw wrong();
  const data = new DataView(chunk.buffer, chunk.byteOffset, chunk.byteLength);
  const [full, count] = [data.getUint32(0, true), data.getUint32(4, true)];
  if (full === 0 || count !== Math.ceil(atlas.frames / full) || chunk.length < 8 + 4 * count) throw wrong();
  const runs: StoredRun[] = [];
  let at = 8 + 4 * count;
  for (let run = 0; run < count; run++) {
    const word = data.getUint32(8 + 4 * run, true);
    const bytes = chunk.subarray(at, at + (word & ~STORED));
    at += word & ~STORED;
    if (at > chunk.length) throw wrong();
    runs.push({ bytes, frame: run * full, frames: Math.min(full, atlas.frames - run * full), stored: word >= STORED });
  }
  if (at !== chunk.length) throw wrong();
  return { full, runs };
}

function inflateRun(atlas: Atlas, frames: number, bytes: Uint8Array): Uint8Array {
  const { channels, edge, encoding } = atlas;
  const size = contentSize(bytes);
  const most = 1 + 255 * 5 * channels + frames * (1 + edge ** 3 * (1 + channels * WIDTHS[encoding.number].bytes));
  if (size === null || !(size <= most)) throw new FieldError(`${atlas.name} has a run that states no length, or one beyond its blocks.`);
  return inflate(bytes, size, atlas.name);
}

/** Number of weights of a channel's predictions. */
function terms(channel: number): number {
  return 2 + Math.min(channel, BEFORE);
}

/** Decodes a run: frame by frame, channel by channel. */
function decodeRun(atlas: Atlas, run: Uint8Array, frames: number, codes: Codes): void {
  const { channels, edge } = atlas;
  const { bytes: width, origin, most, bias } = WIDTHS[atlas.encoding.number];
  const nodes = edge * edge * edge;
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
  const starts = new Int32Array(frames);
  let live = 0;
  for (let mode = 0; mode < modes; mode++) {
    for (let frame = 0; frame < frames; frame++) {
      if (modeOf[frame] !== mode) continue;
      starts[frame] = live;
      for (let byte = frame * liveBytes; byte < (frame + 1) * liveBytes; byte++) live += ONES[bits[byte]];
    }
  }
  for (let frame = 0; frame < frames; frame++) {
    if (modeOf[frame] >= modes) throw wrong("a mode that it does not have");
    if (nodes % 8 > 0 && bits[(frame + 1) * liveBytes - 1] >> (nodes % 8) !== 0) throw wrong("bits of nodes that no block has");
  }
  const residuals = take(live * channels * width);
  if (at !== run.length) throw wrong("bytes after its residuals");
  if (codes instanceof Uint8Array && restoreLanes({ frames, channels, edge, live, residuals, starts, modes: modeOf, weights, bits }, codes)) return;
  const block = { edge, origin, most, mask: new Int32Array(nodes), rank: new Int32Array(nodes) };
  const narrow = width === 1 ? residuals : width === 2 ? pairs(residuals, live, channels) : null;
  const wide = narrow ? new Float64Array(0) : fours(residuals, live, channels);
  // Differences of code and mean, by the channel's number modulo 4.
  const differences = [0, 1, 2, 3].map(() => new Int32Array(nodes));
  const wideDifferences = [0, 1, 2, 3].map(() => new Float64Array(narrow ? 0 : nodes));
  for (let frame = 0; frame < frames; frame++) {
    findResiduals(bits, frame * liveBytes, block);
    for (let channel = 0; channel < channels; channel++) {
      const first = channel * live + starts[frame];
      const [own, d1, d2, d3] = [channel & 3, (channel + 3) & 3, (channel + 2) & 3, (channel + 1) & 3];
      const channelWeights = weights[modeOf[frame]][channel];
      const start = (frame * channels + channel) * nodes;
      if (narrow && !(codes instanceof Uint32Array)) {
        const before = [differences[d1], differences[d2], differences[d3]] as const;
        restore(block, { values: narrow, first, bias }, { weights: channelWeights, before }, codes, start, differences[own]);
      } else {
        const before = [wideDifferences[d1], wideDifferences[d2], wideDifferences[d3]];
        restoreWide(block, { values: wide, first, bias }, { weights: channelWeights, before }, codes, start, wideDifferences[own]);
      }
    }
  }
}

/** Number of set bits of each byte. */
const ONES = Uint8Array.from({ length: 256 }, (_, byte) => byte.toString(2).replaceAll("0", "").length);

/** Finds the nodes of a block with a residual, from bits that start at byte `at`. */
function findResiduals(bits: Uint8Array, at: number, { mask, rank }: { mask: Int32Array; rank: Int32Array }): void {
  let count = 0;
  for (let node = 0; node < mask.length; node++) {
    const bit = (bits[at + (node >> 3)] >> (node & 7)) & 1;
    mask[node] = -bit;
    rank[node] = -bit & count;
    count += bit;
  }
}

/** Two-byte residuals, whose bytes are stored apart in each channel. */
function pairs(bytes: Uint8Array, live: number, channels: number): Uint16Array {
  const out = new Uint16Array(live * channels);
  for (let channel = 0; channel < channels; channel++) {
    for (let i = channel * live, byte = 2 * i; i < (channel + 1) * live; i++, byte++) out[i] = bytes[byte] | (bytes[byte + live] << 8);
  }
  return out;
}

/** Four-byte residuals, stored as in `pairs`. */
function fours(bytes: Uint8Array, live: number, channels: number): Float64Array {
  const out = new Float64Array(live * channels);
  for (let channel = 0; channel < channels; channel++) {
    for (let i = channel * live, byte = 4 * i; i < (channel + 1) * live; i++, byte++) {
      for (let part = 0; part < 4; part++) out[i] += bytes[byte + part * live] * 256 ** part;
    }
  }
  return out;
}

/** Checks that integer codes fit the bits in the metadata, and that floats are numbers. */
function check(atlas: Atlas, codes: Codes): void {
  const { number, bits } = atlas.encoding;
  const wrong = (code: number) => new FieldError(`${atlas.name} holds the code ${code}, which ${number} of ${bits} bits cannot be.`);
  // Ordered bits of infinities and NaNs lie at both ends.
  const ends: Record<typeof number, [number, number]> = { u8: [0, 2 ** bits - 1], u16: [0, 2 ** bits - 1], f16: [0x0400, 0xfbff], f32: [0x00800000, 0xff7fffff] };
  const [least, most] = ends[number];
  if (least === 0 && most === WIDTHS[number].most) return;
  for (let i = 0; i < codes.length; i++) if (codes[i] < least || codes[i] > most) throw wrong(codes[i]);
}
