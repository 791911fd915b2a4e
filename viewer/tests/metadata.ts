/** Containers with other metadata. */

import { crc32 } from "../src/format/crc32.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";

/** A container whose metadata has `to` in place of `from`, and still its length: text of the filter's name gives and takes room. */
export function withMetadata(container: Uint8Array, from: string, to: string): Uint8Array {
  const bytes = new Uint8Array(container);
  const [entry] = readDirectory(readHeader(bytes), bytes);
  const text = new TextDecoder().decode(chunkBytes(entry, bytes, 0));
  const changed = text.replace(from, to);
  if (changed === text) throw new Error(`${from} is not in the metadata`);
  const [, filter] = /"filter":"([^"]*)"/.exec(changed)!;
  const room = text.length - changed.length + filter.length;
  if (room < 1) throw new Error(`${from} leaves no room`);
  const made = changed.replace(`"filter":"${filter}"`, `"filter":"${"x".repeat(room)}"`);
  bytes.set(new TextEncoder().encode(made), entry.offset);
  const data = new DataView(bytes.buffer);
  data.setUint32(64 + 32, crc32(bytes.subarray(entry.offset, entry.offset + entry.bytes)), true);
  data.setUint32(48, 0, true);
  data.setUint32(48, crc32(bytes.subarray(0, entry.offset)), true);
  return bytes;
}
