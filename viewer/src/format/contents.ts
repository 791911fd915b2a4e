/** The chunks that the metadata announces, and the prefixes of levels: sections 1 and 3 of `formats/mipvog.md`. */

import { FieldError } from "../errors.js";
import { KNOWN } from "./generated.js";
import { chunkName, type Entry, type Header, paddedEnd } from "./layout.js";
import { storedGroups, type Metadata, networkOf } from "./metadata.js";

/** Every chunk that the metadata announces is there and no other, in order, coarse to fine, with the right prefix. */
export function checkContents(entries: Entry[], metadata: Metadata, header: Header): void {
  const expected: [string, number | null][] = [["META", null]];
  if (networkOf(metadata)) expected.push(["VMLP", null]);
  if (metadata.free_space) expected.push(["MASK", null]);
  for (let level = metadata.levels.length - 1; level >= 0; level--) {
    expected.push(["TABL", level]);
    for (const { kind } of storedGroups(metadata, level)) expected.push([kind, level]);
  }
  const critical = entries.filter(({ kind }) => KNOWN.includes(kind) && kind !== "prov");
  expected.forEach(([kind, level], i) => {
    if (critical[i]?.kind === kind && critical[i].level === level) return;
    throw new FieldError(`Chunk ${kind}${level === null ? "" : ` of level ${level}`} is missing or out of place.`);
  });
  const extra = critical[expected.length];
  if (extra) throw new FieldError(`${chunkName(extra)} is not announced by the metadata.`);
  for (const entry of entries) {
    const exists = entry.level === null || (entry.kind !== "prov" && entry.level < metadata.levels.length);
    if (!exists) throw new FieldError(`${chunkName(entry)} is of a level that is not there.`);
    if (entry.prefix !== prefixOf(entry.level, entries, metadata, header)) {
      throw new FieldError(`The directory's prefix of ${chunkName(entry)} does not hold the level.`);
    }
  }
}

/** Bytes from the file's start after which a level renders. */
function prefixOf(level: number | null, entries: Entry[], metadata: Metadata, header: Header): number {
  if (level === null) return 0;
  if (metadata.levels.some(({ density }) => density === null)) return header.fileBytes;
  return Math.max(...entries.filter((entry) => entry.level === level).map(paddedEnd));
}
