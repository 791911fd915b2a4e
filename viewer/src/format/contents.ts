/** The chunks implied by the metadata, and the prefixes of levels: sections 1 and 3 of `formats/mipvog.md`. */

import { FieldError } from "../errors.js";
import { KNOWN } from "./generated.js";
import { chunkName, type Entry, type Header, paddedEnd } from "./layout.js";
import { storedGroups, type Metadata, networkOf } from "./metadata.js";
import { partName, partsFrom, partsOf } from "./parts.js";

/** Checks that exactly the chunks implied by the metadata are present, coarse to fine, with the correct prefixes. */
export function checkContents(entries: Entry[], metadata: Metadata, header: Header): void {
  const expected: [string, number | null][] = [["META", null]];
  if (networkOf(metadata)) expected.push(["VMLP", null]);
  if (metadata.free_space) expected.push(["MASK", null]);
  const parts = partsOf(metadata);
  const levels = metadata.levels.length;
  for (const part of partsFrom(metadata, 0)) {
    expected.push(["TABL", part]);
    for (const { kind } of storedGroups(metadata, part)) expected.push([kind, part]);
  }
  const critical = entries.filter(({ kind }) => KNOWN.includes(kind) && kind !== "prov");
  expected.forEach(([kind, part], i) => {
    if (critical[i]?.kind === kind && critical[i].part === part) return;
    throw new FieldError(`Chunk ${kind}${part === null ? "" : ` of ${partName(levels, part)}`} is missing or out of place.`);
  });
  const extra = critical[expected.length];
  if (extra) throw new FieldError(`${chunkName(extra, levels)} is not announced by the metadata.`);
  for (const entry of entries) {
    const exists = entry.part === null || (entry.kind !== "prov" && entry.part < parts.length);
    if (!exists) throw new FieldError(`${chunkName(entry, levels)} is of a level that is not there.`);
    if (entry.prefix !== prefixOf(entry.part, entries, metadata, header)) {
      throw new FieldError(`The directory's prefix of ${chunkName(entry, levels)} does not hold the level.`);
    }
  }
}

/** Bytes from the start of the file that suffice to render a level, or that end with a shell. */
function prefixOf(part: number | null, entries: Entry[], metadata: Metadata, header: Header): number {
  if (part === null) return 0;
  if (partsOf(metadata).some(({ density }) => density === null)) return header.fileBytes;
  return Math.max(...entries.filter((entry) => entry.part === part).map(paddedEnd));
}
