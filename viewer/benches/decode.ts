/**
 * Measures how fast one worker decodes a container, in a fresh process, against a copy of as many bytes.
 *
 *     npm run bench -- scene.mipvog
 *
 * Megabytes are those of codes, and seconds those that the process computed, which other programs disturb less than the
 * clock's. `codes` is zstd and prediction alone; `bricks` is all that a worker does with a level.
 */

import { readFileSync } from "node:fs";
import { CODINGS } from "../src/format/codings/index.js";
import { chunkBytes, readDirectory, readHeader } from "../src/format/layout.js";
import { storedGroups, readMetadata } from "../src/format/metadata.js";
import { levelChunks, LevelDecoder } from "../src/load/level.js";
import { plan } from "../src/load/plan.js";
import { prepareDecoding } from "../src/load/prepare.js";

/** Copies of which the fastest counts. */
const COPIES = 5;

/** Seconds that work takes. */
function seconds(work: () => void): number {
  const before = process.cpuUsage();
  work();
  const { user, system } = process.cpuUsage(before);
  return (user + system) / 1e6;
}

const bytes = Uint8Array.from(readFileSync(process.argv[2]));
await prepareDecoding();
const header = readHeader(bytes);
const entries = readDirectory(header, bytes);
const metadata = readMetadata(chunkBytes(entries[0], bytes, 0));
if (header.features.has("inherited_blocks")) throw new Error("A container without inherited blocks is needed.");
const laidOut = plan(metadata, { side: 2048, bytes: 2 ** 40, uniforms: 1024 }, 0);
const groups = metadata.levels.map((_, number) => storedGroups(metadata, number));
let megabytes = 0;
const codes = seconds(() => {
  metadata.levels.forEach(({ block_size: edge, blocks_stored: frames }, number) => {
    const chunks = levelChunks(entries, number, bytes, 0);
    for (const { kind, encoding, channels } of groups[number]) {
      const decoded = CODINGS[kind].decode({ encoding, channels, edge, frames, name: kind }, chunks[kind].bytes, 0, frames);
      megabytes += decoded.codes.byteLength / 1e6;
    }
  });
});
const bricks = seconds(() => {
  metadata.levels.forEach(({ blocks_stored: blocks }, number) => {
    const decoder = new LevelDecoder(metadata, laidOut, number, levelChunks(entries, number, bytes, 0), null);
    for (const part of decoder.parts(0, blocks)) if (part.blocks === 0) throw new Error("A part without blocks.");
    decoder.entry(decoder.marks, number === metadata.levels.length - 1);
  });
});
const [from, to] = [new Uint8Array(megabytes * 1e6).fill(1), new Uint8Array(megabytes * 1e6).fill(2)];
const copy = Math.min(...Array.from({ length: COPIES }, () => seconds(() => to.set(from))));
const row = (name: string, time: number) => console.log(`| ${name} | ${(megabytes / time).toFixed(0)} | ${(time / copy).toFixed(0)} |`);
console.log(`${megabytes.toFixed(1)} MB of codes from ${(bytes.length / 1e6).toFixed(1)} MB\n\n| | MB/s | times a copy |\n|---|---|---|`);
row("codes", codes);
row("bricks", bricks);
row("copy", copy);
