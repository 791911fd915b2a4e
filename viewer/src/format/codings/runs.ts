/** Runs of zstd frames that hold residuals of a prediction: section 5 of `formats/mipvog.md`. */

import { FieldError } from "../../errors.js";
import { inflate } from "../zstd.js";
import type { Atlas, Codes, Coding } from "./index.js";

const STORED = 0x80000000;

/** Bytes of a code, and the prediction of a block's first node. */
const WIDTHS = {
  u8: { bytes: 1, origin: 0 },
  u16: { bytes: 2, origin: 0 },
  f16: { bytes: 2, origin: 0x8000 },
  f32: { bytes: 4, origin: 0x80000000 },
} as const;

export const decodeRuns: Coding = (atlas, chunk) => {
  const { bytes: width, origin } = WIDTHS[atlas.encoding.number];
  const nodes = atlas.edge ** 3;
  const count = atlas.frames * atlas.channels * nodes;
  const codes: Codes = width === 1 ? new Uint8Array(count) : width === 2 ? new Uint16Array(count) : new Uint32Array(count);
  let frame = 0;
  for (const { bytes, frames, stored } of runs(atlas, chunk)) {
    const size = frames * atlas.channels * width * nodes;
    if (stored && bytes.length !== size) throw new FieldError(`${atlas.name} has a stored run of ${bytes.length} bytes instead of ${size}.`);
    const planes = stored ? bytes : inflate(bytes, size, atlas.name);
    for (let channel = 0; channel < atlas.channels; channel++) {
      for (let i = 0; i < frames; i++) {
        const from = (channel * width * frames + i) * nodes;
        const to = ((frame + i) * atlas.channels + channel) * nodes;
        unpredict(planes, from, frames * nodes, width, origin, codes, to, atlas.edge);
      }
    }
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

/** The codes of one block and channel: each the mean of its lower neighbours, rounded down, and its residual. */
function unpredict(
  planes: Uint8Array,
  from: number,
  planeBytes: number,
  width: number,
  origin: number,
  codes: Codes,
  to: number,
  edge: number,
): void {
  const [dx, dy] = [edge * edge, edge];
  let node = 0;
  for (let x = 0; x < edge; x++) {
    for (let y = 0; y < edge; y++) {
      for (let z = 0; z < edge; z++, node++) {
        let residual = planes[from + node];
        for (let byte = 1; byte < width; byte++) residual += planes[from + byte * planeBytes + node] * 2 ** (8 * byte);
        const at = to + node;
        let sum = 0;
        let neighbours = 0;
        if (x > 0) (sum += codes[at - dx]), neighbours++;
        if (y > 0) (sum += codes[at - dy]), neighbours++;
        if (z > 0) (sum += codes[at - 1]), neighbours++;
        const predicted = neighbours === 0 ? origin : Math.floor(sum / neighbours);
        // Typed arrays keep the low bits.
        codes[at] = predicted + residual;
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
