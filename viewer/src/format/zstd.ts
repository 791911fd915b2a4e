/** The only door to the zstd decoder. */

import { Decompress, decompress } from "fzstd";
import { FieldError } from "../errors.js";

/** Inflates one frame to exactly `length` bytes; `name` is whose they are, for messages. */
export function inflate(bytes: Uint8Array, length: number, name: string): Uint8Array {
  const out = new Uint8Array(length);
  const wrong = () => new FieldError(`${name} holds a broken zstd frame, or one that is not of ${length} bytes.`);
  const stated = contentSize(bytes);
  if (stated !== null && stated !== length) throw wrong();
  try {
    if (stated !== null) {
      decompress(bytes, out);
      return out;
    }
    // A frame that does not say how long it is: what comes out is counted.
    let done = 0;
    new Decompress((piece) => {
      out.set(piece, done);
      done += piece.length;
    }).push(bytes, true);
    if (done === length) return out;
  } catch {
    throw wrong();
  }
  throw wrong();
}

/** What a frame's header says it inflates to; null where it says nothing, NaN where it is no header. */
export function contentSize(frame: Uint8Array): number | null {
  const data = new DataView(frame.buffer, frame.byteOffset, frame.byteLength);
  if (frame.length < 6 || data.getUint32(0, true) !== 0xfd2fb528) return NaN;
  const flags = frame[4];
  const [kind, single, dictionary] = [flags >> 6, (flags >> 5) & 1, [0, 1, 2, 4][flags & 3]];
  const at = 6 - single + dictionary;
  const width = kind === 0 ? single : 1 << kind;
  if (width === 0) return null;
  if (frame.length < at + width) return NaN;
  if (width === 1) return frame[at];
  if (width === 2) return data.getUint16(at, true) + 256;
  return width === 4 ? data.getUint32(at, true) : Number(data.getBigUint64(at, true));
}
