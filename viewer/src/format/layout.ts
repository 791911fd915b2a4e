/** Header and directory: sections 2 and 3 of `formats/mipvog.md`. */

import { FieldError, REMEDY } from "../errors.js";
import { foreign } from "./kinds.js";
import { crc32 } from "./crc32.js";
import { type Feature, FEATURES, KNOWN, MAJOR } from "./generated.js";
import { partName } from "./parts.js";

export const HEADER_BYTES = 64;
export const ENTRY_BYTES = 64;
const ALIGNMENT = 64;
/** The features that this viewer supports. */
const KNOWN_FEATURES = (1n << BigInt(FEATURES.length)) - 1n;
const SIGNATURE = [0x89, 0x4d, 0x56, 0x47, 0x0d, 0x0a, 0x1a, 0x0a];
const NO_PART = 0xffffffff;
/** Maximum number of chunks of a container: 32 levels of 4, plus room for ancillary ones. */
const MOST_CHUNKS = 4096;

export interface Header {
  /** Size of the file in bytes. */
  fileBytes: number;
  chunks: number;
  /** Features that a reader must support. */
  features: Set<Feature>;
}

export interface Entry {
  /** Four letters. */
  kind: string;
  /** Index of a level, 0 being the finest, or of a shell, counted after the levels; null for chunks of no part. */
  part: number | null;
  offset: number;
  bytes: number;
  /** Bytes from the start of the file that suffice to render the level. */
  prefix: number;
  checksum: number;
}

/** Whether bytes start like a container. */
export function isContainer(bytes: Uint8Array): boolean {
  return SIGNATURE.every((byte, i) => bytes[i] === byte);
}

function view(bytes: Uint8Array): DataView {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

/** A u64 that counts bytes of a file; no file exceeds 2^53. */
function length(data: DataView, at: number): number {
  const value = data.getBigUint64(at, true);
  if (value > BigInt(Number.MAX_SAFE_INTEGER)) throw new FieldError(`The number at byte ${at} is impossibly large (${value}).`);
  return Number(value);
}

/** Reads the first 64 bytes. */
export function readHeader(bytes: Uint8Array): Header {
  if (!isContainer(bytes)) throw foreign(bytes);
  if (bytes.length < HEADER_BYTES) throw new FieldError(`The file ends after ${bytes.length} bytes, within its header.`);
  const data = view(bytes);
  const major = data.getUint16(8, true);
  if (major !== MAJOR) throw new FieldError(`The container is of version ${major}; this viewer knows version ${MAJOR}.`, REMEDY.newer);
  const bits = data.getBigUint64(16, true);
  if ((bits & ~KNOWN_FEATURES) !== 0n) throw new FieldError(`The container requires features 0x${bits.toString(16)} that this viewer does not know.`, REMEDY.newer);
  const features = new Set(FEATURES.filter((_, bit) => ((bits >> BigInt(bit)) & 1n) === 1n));
  const header = { fileBytes: length(data, 24), chunks: data.getUint32(40, true), features };
  checkReserved(bytes, [[12, 16], [44, 48], [52, 64]], "The header");
  if (length(data, 32) !== HEADER_BYTES) throw new FieldError("The directory does not follow the header.");
  if (header.chunks === 0 || header.chunks > MOST_CHUNKS) throw new FieldError(`The header speaks of ${header.chunks} chunks; 1 to ${MOST_CHUNKS} can be.`);
  return header;
}

/** Reads the directory from the file's first `64 + 64 * chunks` bytes, and checks header and directory. */
export function readDirectory(header: Header, bytes: Uint8Array): Entry[] {
  const end = HEADER_BYTES + ENTRY_BYTES * header.chunks;
  const head = bytes.slice(0, end);
  if (head.length < end) throw new FieldError(`The file ends after ${bytes.length} bytes, within its directory.`);
  const data = view(head);
  const expected = data.getUint32(48, true);
  head.fill(0, 48, 52);
  const found = crc32(head);
  if (found !== expected) throw new FieldError(`The checksum of header and directory is ${hex(found)} and should be ${hex(expected)}.`);
  const entries: Entry[] = [];
  let next = end;
  for (let i = 0; i < header.chunks; i++) {
    const at = HEADER_BYTES + ENTRY_BYTES * i;
    const part = data.getUint32(at + 4, true);
    const entry = {
      kind: String.fromCharCode(...head.subarray(at, at + 4)),
      part: part === NO_PART ? null : part,
      offset: length(data, at + 8),
      bytes: length(data, at + 16),
      prefix: length(data, at + 24),
      checksum: data.getUint32(at + 32, true),
    };
    checkReserved(head, [[at + 36, at + ENTRY_BYTES]], "The directory");
    checkEntry(entry, entries, next, header);
    next = paddedEnd(entry);
    entries.push(entry);
  }
  if (next !== header.fileBytes) throw new FieldError(`The chunks end at byte ${next}, the file at ${header.fileBytes}.`);
  return entries;
}

/** Checks that reserved bytes are zero. */
function checkReserved(bytes: Uint8Array, fields: [number, number][], where: string): void {
  const isSet = ([from, to]: [number, number]) => bytes.subarray(from, to).some((byte) => byte !== 0);
  if (fields.some(isSet)) throw new FieldError(`${where} has a reserved byte that is set.`, REMEDY.newer);
}

/** Offset of the first byte after a chunk's padding. */
export function paddedEnd({ offset, bytes }: Entry): number {
  return Math.ceil((offset + bytes) / ALIGNMENT) * ALIGNMENT;
}

function checkEntry(entry: Entry, before: Entry[], next: number, header: Header): void {
  const { kind, part } = entry;
  if (!/^[A-Za-z]{4}$/.test(kind)) throw new FieldError(`A chunk's type is not four letters.`);
  if (entry.offset !== next || entry.offset + entry.bytes > header.fileBytes) {
    throw new FieldError(`Chunk ${kind} lies at byte ${entry.offset} with ${entry.bytes} bytes; it should start at ${next} and end within the file.`);
  }
  const critical = kind[0] === kind[0].toUpperCase();
  if (!KNOWN.includes(kind)) {
    if (critical) throw new FieldError(`The container needs the chunk ${kind}, which this viewer does not know.`, REMEDY.newer);
  } else if (before.some((other) => other.kind === kind && other.part === part)) {
    throw new FieldError(`Chunk ${kind} is there twice.`);
  }
}

/**
 * The bytes of a chunk, with a verified checksum. `bytes` starts at byte `start` of the file, which has `levels`
 * levels.
 */
export function chunkBytes(entry: Entry, bytes: Uint8Array, start: number, levels = Infinity): Uint8Array {
  const chunk = bytes.subarray(entry.offset - start, entry.offset - start + entry.bytes);
  const found = crc32(chunk);
  if (chunk.length === entry.bytes && found === entry.checksum) return chunk;
  throw new FieldError(`${chunkName(entry, levels)} at byte ${entry.offset} is damaged: its checksum is ${hex(found)} and should be ${hex(entry.checksum)}.`);
}

/** The name of a chunk, for messages. */
export function chunkName(entry: Entry, levels = Infinity): string {
  return entry.part === null ? `Chunk ${entry.kind}` : `Chunk ${entry.kind} of ${partName(levels, entry.part)}`;
}

function hex(value: number): string {
  return value.toString(16).padStart(8, "0");
}
