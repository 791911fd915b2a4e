/** The rules of `formats/mipvog.md` that a reader of prefixes holds: broken containers are refused before a level is read. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { checkContents } from "../src/format/contents.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMetadata } from "../src/format/metadata.js";
import { ROOT } from "./support.js";

function open(bytes: Uint8Array): void {
  const header = readHeader(bytes);
  const entries = readDirectory(header, bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  checkContents(entries, metadata, header);
}

const REFUSED = [
  "header", "feature", "directory", "chunk-bounds", "chunk-unknown", "chunk-unexpected", "chunk-missing", "prefix",
  "metadata-value", "ray-samples",
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
