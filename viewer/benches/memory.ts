/**
 * Prints how much of a device's memory containers take, beside the bytes of the files.
 *
 *     npm run bench:memory -- a.mipvog b.mipvog
 *
 * `codes` are one byte for each stored node and channel, `skips` the distances by which rays skip what is empty.
 */

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { readMask } from "../src/format/mask.js";
import { readMetadata } from "../src/format/metadata.js";
import { plan } from "../src/load/plan.js";
import { macroSides } from "../src/load/skip.js";
import { storedCodes } from "../src/load/texels.js";

console.log("| container | bytes | textures | times the file | codes | skips |\n|---|---|---|---|---|---|");
for (const path of process.argv.slice(2)) {
  const bytes = Uint8Array.from(readFileSync(path));
  const entries = readDirectory(readHeader(bytes), bytes);
  const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
  const mask = entries.find(({ kind }) => kind === "MASK");
  const others = mask && metadata.free_space ? readMask(chunkBytes(mask, bytes, 0)).values.byteLength : 0;
  const laidOut = plan(metadata, { side: 2048, bytes: 2 ** 40, uniforms: 1024 }, 0, others);
  const codes = storedCodes(metadata);
  const [x, y, z] = macroSides(metadata);
  const times = (part: number) => (part / bytes.length).toFixed(2);
  console.log(`| ${basename(path)} | ${bytes.length} | ${laidOut.bytes} | ${times(laidOut.bytes)} | ${times(codes)} | ${times(4 * x * y * z)} |`);
}
