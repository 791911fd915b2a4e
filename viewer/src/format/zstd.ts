/** The only interface to the zstd decoders. */

import { Decompress, decompress } from "fzstd";
import { ZSTDDecoder } from "zstddec";
import { FieldError } from "../errors.js";

/** The fast decoder, in WebAssembly; null if a page's security policy does not allow it. */
let native: ZSTDDecoder | null = null;

/** Makes `inflate` fast if the page allows WebAssembly; otherwise, the result is the same. */
export async function prepareInflate(): Promise<void> {
  const decoder = new ZSTDDecoder();
  try {
    await decoder.init();
    native = decoder;
  } catch {
    native = null;
  }
}

/** Decompresses exactly one frame to exactly `length` bytes. `name` describes the bytes in messages. */
export function inflate(bytes: Uint8Array, length: number, name: string): Uint8Array {
  const wrong = () => new FieldError(`${name} holds a broken zstd frame, or one that is not of ${length} bytes.`);
  const header = headerOf(bytes);
  if (!header || !isOneFrame(bytes, header)) throw wrong();
  const stated = header.content;
  if (stated !== null && stated !== length) throw wrong();
  try {
    if (stated === null) return inflateUnstated(bytes, length);
    if (!native || length === 0) return decompress(bytes, new Uint8Array(length));
    const out = native.decode(bytes, length);
    // After an error fewer bytes come, or none.
    if (out.length === length) return out;
  } catch {
    throw wrong();
  }
  throw wrong();
}

/** Decompresses a frame that does not state its length, and counts the output. */
function inflateUnstated(bytes: Uint8Array, length: number): Uint8Array {
  const out = new Uint8Array(length);
  let done = 0;
  new Decompress((piece) => {
    out.set(piece, done);
    done += piece.length;
  }).push(bytes, true);
  if (done !== length) throw new RangeError();
  return out;
}

interface FrameHeader {
  /** Decompressed length that the frame states; null if it states none. */
  content: number | null;
  /** Length of the header in bytes. */
  bytes: number;
  hasChecksum: boolean;
}

/** The header of a frame; null if the bytes do not start with one. */
function headerOf(frame: Uint8Array): FrameHeader | null {
  const data = new DataView(frame.buffer, frame.byteOffset, frame.byteLength);
  if (frame.length < 6 || data.getUint32(0, true) !== 0xfd2fb528) return null;
  const flags = frame[4];
  const [kind, single, dictionary] = [flags >> 6, (flags >> 5) & 1, [0, 1, 2, 4][flags & 3]];
  const at = 6 - single + dictionary;
  const width = kind === 0 ? single : 1 << kind;
  if (frame.length < at + width) return null;
  const header = { bytes: at + width, hasChecksum: (flags & 4) !== 0 };
  if (width === 0) return { content: null, ...header };
  if (width === 1) return { content: frame[at], ...header };
  if (width === 2) return { content: data.getUint16(at, true) + 256, ...header };
  return { content: width === 4 ? data.getUint32(at, true) : Number(data.getBigUint64(at, true)), ...header };
}

/** Whether the bytes end with their first frame: decoders continue with a second frame, or ignore what follows. */
function isOneFrame(bytes: Uint8Array, header: FrameHeader): boolean {
  let at = header.bytes;
  for (let isLast = false; !isLast; ) {
    if (at + 3 > bytes.length) return false;
    const block = bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16);
    isLast = (block & 1) === 1;
    // A block that repeats one byte holds that byte alone.
    at += 3 + (((block >> 1) & 3) === 1 ? 1 : block >> 3);
  }
  return at + (header.hasChecksum ? 4 : 0) === bytes.length;
}

/** Decompressed length that a frame's header states; null if it states none, NaN if there is no header. */
export function contentSize(frame: Uint8Array): number | null {
  const header = headerOf(frame);
  return header ? header.content : NaN;
}
