/** Levels of containers with chunks that this viewer does not know, which may lie anywhere behind the metadata. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { crc32 } from "../src/format/crc32.js";
import { ENTRY_BYTES, HEADER_BYTES, readDirectory, readHeader } from "../src/format/layout.js";
import { Loader } from "../src/load/loader.js";
import { ROOT } from "./support.js";

const DEVICE = { side: 2048, bytes: 2 ** 30, uniforms: 1024 };

/** A container with one more chunk, of 4 bytes and of a level, behind all others. */
function withLast(container: Uint8Array, kind: string, level: number): Uint8Array<ArrayBuffer> {
  const entries = readDirectory(readHeader(container), container);
  const end = HEADER_BYTES + ENTRY_BYTES * entries.length;
  const out = new Uint8Array(container.length + 2 * ENTRY_BYTES);
  out.set(container.subarray(0, end));
  out.set(container.subarray(end), end + ENTRY_BYTES);
  out.set([1, 2, 3, 4], container.length + ENTRY_BYTES);
  const data = new DataView(out.buffer);
  const put = (at: number, value: number) => data.setBigUint64(at, BigInt(value), true);
  put(24, out.length);
  data.setUint32(40, entries.length + 1, true);
  entries.forEach((entry, number) => {
    const at = HEADER_BYTES + ENTRY_BYTES * number;
    put(at + 8, entry.offset + ENTRY_BYTES);
    if (entry.part !== null) put(at + 24, entry.part === level ? out.length : entry.prefix + ENTRY_BYTES);
  });
  out.set(new TextEncoder().encode(kind), end);
  data.setUint32(end + 4, level, true);
  put(end + 8, container.length + ENTRY_BYTES);
  put(end + 16, 4);
  put(end + 24, out.length);
  data.setUint32(end + 32, crc32(Uint8Array.of(1, 2, 3, 4)), true);
  data.setUint32(48, 0, true);
  data.setUint32(48, crc32(out.subarray(0, end + ENTRY_BYTES)), true);
  return out;
}

/** The levels that come, in order. */
async function load(bytes: Uint8Array<ArrayBuffer>): Promise<number[]> {
  const levels: number[] = [];
  const nothing = () => {};
  const listener = { opened: nothing, progress: nothing, residents: () => {}, begun: nothing, part: nothing, entry: ({ part }: { part: number }) => levels.push(part) };
  await new Loader(new Blob([bytes]), {}, listener).load(DEVICE);
  return levels;
}

for (const name of ["tiny.rate", "tiny.paper", "tiny.rate.filled"]) {
  test(`all levels of ${name} come, though a chunk of the coarsest one lies behind the finest`, async () => {
    const container = new Uint8Array(readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
    const levels = await load(container);
    assert.ok(levels.length > 2 && levels.at(-1) === 0, `levels ${levels}`);
    const extended = withLast(container, "note", levels[0]);
    assert.deepEqual(await load(extended), levels);
    // The first part of it that ends at level 1 has all of the coarser levels but their note.
    const { prefix } = readDirectory(readHeader(extended), extended).find(({ part }) => part === 1)!;
    if (prefix < extended.length) assert.deepEqual(await load(extended.slice(0, prefix)), levels.slice(0, -1));
  });
}
