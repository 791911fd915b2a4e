/** The rules of `formats/mipvog.md` that a reader of prefixes holds. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { checkContents } from "../src/format/contents.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { valueTable } from "../src/format/codings/values.js";
import { readMask } from "../src/format/mask.js";
import { type Metadata, readMetadata } from "../src/format/metadata.js";
import { inflate } from "../src/format/zstd.js";
import { ROOT } from "./support.js";

function open(bytes: Uint8Array): void {
  const header = readHeader(bytes);
  const entries = readDirectory(header, bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  checkContents(entries, metadata, header);
}

const REFUSED = [
  "header", "feature", "directory", "chunk-bounds", "chunk-unknown", "chunk-unexpected", "chunk-missing", "prefix",
  "metadata-value", "ray-samples", "nested-boxes",
];
/** The length of the file, bytes between chunks, ancillary chunks and the canonical form: these rules may be skipped. */
const SKIPPED = ["length", "padding", "provenance", "chunk-checksum", "metadata"];

function broken(code: string): Uint8Array {
  return readFileSync(join(ROOT, "fixtures", "broken", `${code}.mipvog`));
}

for (const code of REFUSED) {
  test(`a container with the finding ${code} is refused`, () => {
    assert.throws(() => open(broken(code)), { name: "FieldError" });
  });
}

test("rules that a reader of prefixes may skip are the only ones that are skipped", () => {
  SKIPPED.forEach((code) => open(broken(code)));
  open(broken("sound"));
});

/** The metadata of a sound container after a change. */
function changed(change: (metadata: Metadata) => void): () => Metadata {
  const bytes = broken("sound");
  const [meta] = readDirectory(readHeader(bytes), bytes);
  const metadata = JSON.parse(new TextDecoder().decode(chunkBytes(meta, bytes, 0)));
  change(metadata);
  return () => readMetadata(new TextEncoder().encode(JSON.stringify(metadata)));
}

test("a level of more than 2^26 blocks is refused, with how many there are and may be", () => {
  const sized = (edge: number) =>
    changed(({ levels, march }) => {
      march.stepsize = 1;
      levels.length = 1;
      Object.assign(levels[0], { dimensions: [edge, 1024, 1024], block_size: 2 });
    });
  sized(512)();
  assert.throws(sized(514), { name: "FieldError", message: /67371008 blocks.*67108864 at most/ });
});

test("floats have neither center nor step nor curve nor a code for empty", () => {
  const float = (more: object) => changed(({ levels }) => Object.assign(levels[0].diffuse, { number: "f16", bits: 16, center: 0, step: 0, curve: 0, empty_code: false }, more));
  float({})();
  for (const more of [{ center: 1 }, { step: 1 }, { curve: 1 }, { empty_code: true }]) assert.throws(float(more), { name: "FieldError" });
});

test("keys that every object has are no keys of the metadata", () => {
  assert.throws(changed((metadata) => Object.assign(metadata, { toString: 1 })), { name: "FieldError", message: /toString is not known/ });
});

test("the value of an empty code comes before those of all others", () => {
  const { diffuse } = changed(() => {})().levels[0];
  const encoding = { ...diffuse, number: "u8", bits: 8, center: 0, step: 1, curve: 0, empty_code: true } as const;
  const table = (empty: number) => valueTable({ ...encoding, empty }, "DIFF", (value) => value);
  assert.equal(table(-1000)![0], -1000);
  for (const empty of [-127, 5]) assert.throws(() => table(empty), { name: "FieldError", message: /do not ascend/ });
});

/** A zstd frame of one block, of stored bytes. */
function frameOf(...bytes: number[]): number[] {
  const block = (bytes.length << 3) | 1;
  return [0x28, 0xb5, 0x2f, 0xfd, 0x20, bytes.length, block & 255, block >> 8, 0, ...bytes];
}

test("what is compressed is one zstd frame, and nothing stands behind it", () => {
  const inflated = (...bytes: number[]) => Array.from(inflate(Uint8Array.from(bytes), 3, "it"));
  assert.deepEqual(inflated(...frameOf(1, 2, 3)), [1, 2, 3]);
  const skippable = [0x50, 0x2a, 0x4d, 0x18, 1, 0, 0, 0, 7];
  for (const behind of [[0], skippable, frameOf(), frameOf(1, 2, 3)]) {
    assert.throws(() => inflated(...frameOf(1, 2, 3), ...behind), { name: "FieldError" });
  }
  assert.throws(() => inflated(...skippable, ...frameOf(1, 2, 3)), { name: "FieldError" });
  assert.throws(() => inflated(...frameOf(1, 2, 3).slice(0, -1)), { name: "FieldError" });
});

test("a mask's reserved bytes are zero, and so is the threshold beside a nearest lookup", () => {
  const mask = (at: number, byte: number) => {
    const head = new Uint8Array(72);
    for (const place of [4, 8, 12]) head[place] = 2;
    head[at] = byte;
    return () => readMask(Uint8Array.from([...head, ...frameOf(0, 1, 0, 1, 0, 1, 0, 1)]));
  };
  assert.deepEqual(mask(4, 2)().nodes, [2, 2, 2]);
  for (const at of [64, 67, 68, 71]) assert.throws(mask(at, 0x80), { name: "FieldError" }, `byte ${at}`);
});
