/** A level, decoded and laid out for the device. */

import { FieldError } from "../errors.js";
import { type Colors, inherit } from "../format/codings/inherit.js";
import { CODINGS, type Codes } from "../format/codings/index.js";
import { toHalf, values, type Value } from "../format/codings/values.js";
import { chunkBytes, chunkName, type Entry } from "../format/layout.js";
import { blockCounts, colorGroups, type Encoding, type Metadata, type Triple } from "../format/metadata.js";
import { inflate } from "../format/zstd.js";
import { interpolatedDensity } from "./interpolated.js";
import { type Plan, slotPlace } from "./plan.js";
import { MacroCells } from "./skip.js";

export interface DecodedLevel {
  level: number;
  /** Stored blocks. */
  blocks: number;
  /** Texels along a brick: a block and its apron. */
  side: number;
  /** The slot of each block: 0 for none, else a set bit 30 and its place in 10 bits along each axis. C order. */
  table: Uint32Array;
  /** Bricks of density, one after the other, in 32 or 16 bits; null where the level has none. */
  density: Float32Array | Uint16Array | null;
  /** Bricks of colour in four halves a texel; a block's quadruples of channels one after the other. */
  color: Uint16Array;
  /** The skip distance of each macro cell; null where the level has no density. */
  skipDistances: Uint8Array | null;
}

/** Colours of a level by their chunks, for inherited blocks of the next finer one. */
export type LevelColors = Record<string, Colors>;

/**
 * Decodes a level. `bytes` are those of the file from `start` on, and hold the level's chunks; inherited blocks are made of
 * the `coarser` level's colours.
 */
export function decodeLevel(
  metadata: Metadata,
  entries: Entry[],
  plan: Plan,
  level: number,
  bytes: Uint8Array,
  start: number,
  coarser: LevelColors | null,
): { decoded: DecodedLevel; colors: LevelColors } {
  const stored = metadata.levels[level];
  const chunk = (kind: string) => {
    const entry = entries.find((entry) => entry.kind === kind && entry.level === level);
    if (!entry) throw new FieldError(`Level ${level} has no chunk ${kind}.`);
    return { name: chunkName(entry), bytes: chunkBytes(entry, bytes, start) };
  };
  const blocks = new Blocks(blockCounts(stored), chunk("TABL"));
  if (blocks.places.length !== stored.blocks_stored) {
    throw new FieldError(`Level ${level} stores ${blocks.places.length} blocks; the metadata says ${stored.blocks_stored}.`);
  }
  if (blocks.inheritedCount !== (stored.blocks_filled ?? 0)) {
    throw new FieldError(`Level ${level} inherits ${blocks.inheritedCount} blocks; the metadata says ${stored.blocks_filled ?? 0}.`);
  }
  const edge = stored.block_size;
  const colors: LevelColors = {};
  const bricks = (kind: string, encoding: Encoding, channels: number): Bricks => {
    const { name, bytes } = chunk(kind);
    const colored = kind !== "DENS";
    const frames = blocks.places.length - (colored ? blocks.inheritedCount : 0);
    let codes = CODINGS[kind]({ encoding, channels, edge, frames, name }, bytes);
    if (colored && blocks.inheritedCount > 0) {
      if (!coarser) throw new FieldError(`Level ${level} has inherited blocks, but the level that they are made of is missing.`);
      codes = inherit({ level: stored, encoding, channels, name }, codes, blocks.places, (block) => blocks.isInherited(block), coarser[kind]);
    }
    if (colored) colors[kind] = { level: stored, frames: blocks.frames, encoding, codes, channels };
    return { codes, channels, edge, blocks, encoding, name };
  };
  const { density: encoding } = stored;
  const nodes = (edge + 1) ** 3;
  let density: DecodedLevel["density"] = null;
  let skipDistances: Uint8Array | null = null;
  if (encoding) {
    const map = interpolatedDensity(metadata.activation, encoding.decode);
    const full = new Float32Array(blocks.places.length * nodes);
    fill(bricks("DENS", encoding, 1), map, full, (block) => block * nodes, 1);
    skipDistances = new MacroCells(metadata, level).skipDistances(full, blocks.places);
    density = plan.floatLinear ? full : Uint16Array.from(full, toHalf);
  }
  const color = new Uint16Array(blocks.places.length * plan.quads * nodes * 4);
  const lane = (first: number) => (block: number, channel: number) => {
    const at = first + channel;
    return ((block * plan.quads + (at >> 2)) * nodes) * 4 + (at & 3);
  };
  let first = 0;
  for (const { kind, encoding, channels } of colorGroups(metadata, level)) {
    fill(bricks(kind, encoding, channels), toHalf, color, lane(first), 4);
    first += channels;
  }
  const table = blocks.table((frame) => slotPlace(plan, plan.firstSlot[level] + frame));
  return { decoded: { level, blocks: blocks.places.length, side: edge + 1, table, density, color, skipDistances }, colors };
}

/** The table of blocks, chunk TABL. */
class Blocks {
  /** Blocks with a frame, in order. */
  readonly places: Triple[] = [];
  /** The frame of each block; -1 of those without. */
  readonly frames: Int32Array;
  /** By frame, whether the block's colours are inherited from the next coarser level. */
  private readonly inherited: boolean[] = [];

  constructor(
    readonly counts: Triple,
    chunk: { name: string; bytes: Uint8Array },
  ) {
    const [nx, ny, nz] = counts;
    const occupied = inflate(chunk.bytes, nx * ny * nz, chunk.name);
    this.frames = new Int32Array(occupied.length).fill(-1);
    occupied.forEach((stored, block) => {
      if (stored > 2) throw new FieldError(`${chunk.name} says ${stored} of block ${block}, neither empty nor stored nor inherited.`);
      if (stored === 0) return;
      this.frames[block] = this.places.length;
      this.inherited.push(stored === 2);
      this.places.push([Math.floor(block / nz / ny), Math.floor(block / nz) % ny, block % nz]);
    });
  }

  get inheritedCount(): number {
    return this.inherited.filter((inherited) => inherited).length;
  }

  isInherited(frame: number): boolean {
    return this.inherited[frame];
  }

  /** The frame of a block; -1 where it is not stored or there is none. */
  frame([x, y, z]: Triple): number {
    const [nx, ny, nz] = this.counts;
    return x < nx && y < ny && z < nz ? this.frames[(x * ny + y) * nz + z] : -1;
  }

  table(place: (frame: number) => Triple): Uint32Array {
    return Uint32Array.from(this.frames, (frame) => {
      if (frame < 0) return 0;
      const [x, y, z] = place(frame);
      return (1 << 30) | (z << 20) | (y << 10) | x;
    });
  }
}

/** One group of a level, to be made bricks of. */
interface Bricks {
  codes: Codes;
  channels: number;
  edge: number;
  blocks: Blocks;
  encoding: Encoding;
  name: string;
}

/**
 * Writes every block with its apron: the lowest nodes of the next blocks, `empty` where the next is not stored. The
 * brick of a block and channel starts at `first`, its nodes `stride` apart.
 */
function fill(
  { codes, channels, edge, blocks, encoding, name }: Bricks,
  map: Value,
  out: Float32Array | Uint16Array,
  first: (block: number, channel: number) => number,
  stride: number,
): void {
  const value = values(encoding, name, map);
  const empty = map(encoding.empty);
  const side = edge + 1;
  blocks.places.forEach(([bx, by, bz], block) => {
    for (let corner = 0; corner < 8; corner++) {
      const up: Triple = [corner >> 2, (corner >> 1) & 1, corner & 1];
      const frame = blocks.frame([bx + up[0], by + up[1], bz + up[2]]);
      // The block itself, or the lowest nodes of a neighbour along each axis that is up.
      const [cx, cy, cz] = up.map((up) => (up ? 1 : edge));
      for (let channel = 0; channel < channels; channel++) {
        const start = first(block, channel);
        const from = (frame * channels + channel) * edge ** 3;
        for (let x = 0; x < cx; x++) {
          for (let y = 0; y < cy; y++) {
            const node = ((x + up[0] * edge) * side + y + up[1] * edge) * side + up[2] * edge;
            const row = from + (x * edge + y) * edge;
            for (let z = 0; z < cz; z++) out[start + (node + z) * stride] = frame < 0 ? empty : value(codes[row + z]);
          }
        }
      }
    }
  });
}
