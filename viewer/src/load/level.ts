/** Decodes levels and shells, and lays them out for the device piece by piece. */

import { FieldError } from "../errors.js";
import { type Colors, inherit } from "../format/codings/inherit.js";
import { type Atlas, CODINGS, type Codes } from "../format/codings/index.js";
import { toHalf, type Value, values, valueTable } from "../format/codings/values.js";
import { KNOWN } from "../format/generated.js";
import { chunkBytes, chunkName, type Entry } from "../format/layout.js";
import { ANISOTROPY, blockCounts, DIRECTIONAL, type Encoding, hasLevels, isColor, type LevelMetadata, type Metadata, storedGroups, type Triple } from "../format/metadata.js";
import { boxesReading, isNested, partName, partsOf } from "../format/parts.js";
import { Blocks } from "./blocks.js";
import { codeBricks, halfBricks, type Lane, seenBricks, type Seen } from "./bricks.js";
import { interpolatedDensity } from "./interpolated.js";
import { partIsDirectional, type Plan, slotPlace } from "./plan.js";
import { freePlace, MacroCells, macroCounts, occupiedShares } from "./skip.js";
import { isDirectional, TEXEL_BYTES, type Texel } from "./texels.js";
import { weaveBricks } from "./weaver.js";

/** Approximate bytes of a piece's bricks. */
const PART_BYTES = 4 << 20;

/** Until finer levels are known, the standpoint is at least this fraction of the box away from the nearest matter. */
const FREE_ENOUGH = 12;

/** Room for codes, relative to those requested at once. */
const ROOM = 1.25;

/** Consecutive blocks of a level or a shell. */
export interface DecodedPart {
  /** Index of the part among the field's parts. */
  part: number;
  /** Index of the first block. */
  first: number;
  blocks: number;
  /** Texels along each edge of a brick. */
  side: number;
  /**
   * Bricks of density, one after the other: codes, or values as half or 32-bit floats. Null without density, or if the
   * colour bricks contain it.
   */
  density: Uint8Array | Uint16Array | Float32Array | null;
  /** Bricks of colour with four codes or halves per texel: the first quadruple of channels, then the next one. */
  color: Uint8Array | Uint16Array;
  /** Bricks of direction-dependent values: anisotropy, then directional brightness. Null without any. */
  directional: Uint8Array | Uint16Array | null;
  /** Slot of each block; null if slots follow the order of the level. */
  slots: Uint32Array | null;
}

/** Skip distances of a box's macro cells for one part. */
export interface Skips {
  box: number;
  distances: Uint8Array;
}

/** The data that enters a level or a shell into the tables, after its blocks. */
export interface LevelEntry {
  part: number;
  /** The entry of each block in C order, from `Blocks.table`. */
  table: Uint32Array;
  /** Skip distances for each box that reads the part; empty without density, or if only the table has changed. */
  skips: Skips[];
  /** Two corners of the visible part of the level, as fractions of box 0; null if not requested, or without density. */
  occupied: [number[], number[]] | null;
  /**
   * The centre of the free space in a world's box 0, as fractions of the box; null if there is none or it is unknown.
   */
  free: number[] | null;
}

/** A level's chunks by kind. */
export type Chunks = Record<string, { name: string; bytes: Uint8Array }>;

/** Colours of a level by chunk kind, for inherited blocks of the next finer level. */
export type LevelColors = Record<string, Colors>;

/** The chunks that a part is decoded from. Unknown chunks can be anywhere. */
export function levelEntries(entries: Entry[], part: number): Entry[] {
  return entries.filter((entry) => entry.part === part && KNOWN.includes(entry.kind));
}

/**
 * The chunks of a part, with verified checksums. `bytes` are bytes of the file from `start` on; the file has `levels`
 * levels.
 */
export function levelChunks(entries: Entry[], part: number, bytes: Uint8Array, start: number, levels = Infinity): Chunks {
  const own = levelEntries(entries, part);
  return Object.fromEntries(own.map((entry) => [entry.kind, { name: chunkName(entry, levels), bytes: chunkBytes(entry, bytes, start, levels) }]));
}

/** Decodes one level or shell. */
export class LevelDecoder {
  readonly blocks: Blocks;
  private readonly stored: LevelMetadata;
  private readonly groups: Group[];
  private readonly macro: MacroCells;

  /** Inherited blocks take their colours from the `coarser` level. */
  constructor(
    private readonly metadata: Metadata,
    private readonly plan: Plan,
    private readonly number: number,
    private readonly chunks: Chunks,
    coarser: LevelColors | null,
  ) {
    const stored = (this.stored = partsOf(metadata)[number]);
    const name = partName(metadata.levels.length, number).replace(/^./, (letter) => letter.toUpperCase());
    const chunk = (kind: string) => {
      if (!chunks[kind]) throw new FieldError(`${name} has no chunk ${kind}.`);
      return chunks[kind];
    };
    this.blocks = new Blocks(blockCounts(stored), chunk("TABL"), isNested(metadata));
    const { places, inheritedCount } = this.blocks;
    if (places.length !== stored.blocks_stored) {
      throw new FieldError(`${name} stores ${places.length} blocks; the metadata says ${stored.blocks_stored}.`);
    }
    if (inheritedCount !== (stored.blocks_filled ?? 0)) {
      throw new FieldError(`${name} inherits ${inheritedCount} blocks; the metadata says ${stored.blocks_filled ?? 0}.`);
    }
    this.groups = storedGroups(metadata, number).map(({ kind, encoding, channels, color }) => {
      const { name: own, bytes } = chunk(kind);
      const colored = color && inheritedCount > 0;
      const atlas = { encoding, channels, edge: stored.block_size, frames: places.length - (colored ? inheritedCount : 0), name: own };
      const map = kind === "DENS" ? interpolatedDensity(metadata.activation, encoding.decode) : (value: number) => value;
      const group = new Group(kind, atlas, bytes, map);
      if (!colored) return group;
      if (!coarser) throw new FieldError(`${name} has inherited blocks, but the level that they are made of is missing.`);
      const { codes } = group.decode(0, atlas.frames);
      const known = inherit({ level: stored, ...atlas }, codes, places, (block) => this.blocks.isInherited(block), coarser[kind]);
      group.give(known);
      return group;
    });
    this.macro = new MacroCells(metadata, number);
  }

  /** The blocks `[from, to)` in order, in parts of a few megabytes. */
  *parts(from: number, to: number): Generator<DecodedPart> {
    const { texels, quads, directionalQuads } = this.plan;
    const bytes = TEXEL_BYTES[texels.density] + 4 * (quads * TEXEL_BYTES[texels.color] + directionalQuads * TEXEL_BYTES[texels.directional]);
    const step = Math.max(1, Math.floor(PART_BYTES / (this.stored.block_size ** 3 * bytes)));
    for (let first = from; first < to; first += step) yield this.part(first, Math.min(to, first + step));
  }

  /** Copies of the chunk data that a helper needs for the blocks `[from, to)`, of a level without inherited blocks. */
  share(from: number, to: number): Chunks {
    const end = this.blocks.reach(to);
    const { name, bytes } = this.chunks.TABL;
    // What can be seen of a block's last cells is told by nodes of the next ones.
    const endOf = (kind: string) => (kind === "DENS" || kind === "ANIS" ? end : to);
    const groups = this.groups.map((group) => [group.kind, { name: group.name, bytes: group.share(from, endOf(group.kind)) }]);
    return { TABL: { name, bytes: bytes.slice() }, ...Object.fromEntries(groups) };
  }

  private part(from: number, to: number): DecodedPart {
    const { metadata, plan, number, groups } = this;
    const { quads, directionalQuads, texels } = plan;
    const edge = this.stored.block_size;
    const [count, nodes] = [to - from, edge ** 3];
    const bricks = (texel: Texel, quads: number, lanes: (Lane | null)[]) => {
      if (texel !== "codes") return halfBricks(lanes, quads, count, nodes);
      return weaveBricks(lanes, quads, count, nodes) ?? codeBricks(lanes, quads, count, nodes);
    };
    const lanesOf = (own: Group[]) => own.flatMap((group) => group.lanes(from, to));
    const directional = () => {
      // Parts may lack what others of the field have.
      const of = (kind: string, channels: number) => {
        const own = groups.filter((group) => group.kind === kind);
        return own.length > 0 ? lanesOf(own) : new Array<null>(channels).fill(null);
      };
      return [...(hasLevels(metadata, "anisotropy") ? of("ANIS", ANISOTROPY) : []), ...(hasLevels(metadata, "directional") ? of("DIRB", DIRECTIONAL) : [])];
    };
    const density = this.density(from, to);
    const colors: (Lane | null)[] = lanesOf(groups.filter(({ kind }) => kind !== "DENS" && !isDirectional(kind)));
    if (texels.density === "beside") colors[4 * quads - 1] = lanesOf(groups.filter(({ kind }) => kind === "DENS"))[0] ?? null;
    return {
      part: number,
      first: from,
      blocks: count,
      side: edge,
      density,
      color: bricks(texels.color, quads, colors),
      directional: partIsDirectional(metadata, number) ? bricks(texels.directional, directionalQuads, directional()) : null,
      slots: null,
    };
  }

  /** Marks macro cells. Returns the bricks of density; null without density, or if the colour bricks contain it. */
  private density(from: number, to: number): DecodedPart["density"] {
    const { blocks, macro, groups, plan } = this;
    const edge = this.stored.block_size;
    const density = groups.find(({ kind }) => kind === "DENS");
    if (!density) return null;
    const end = blocks.reach(to);
    const { codes, table } = density.looked(from, end);
    const anisotropy = groups.find(({ kind }) => kind === "ANIS");
    const sees = (value: number): 0 | 1 => (value > macro.limit ? 1 : 0);
    const empty = sees(density.map(density.encoding.empty));
    let seen: Seen = { codes, first: from, table: Uint8Array.from(table, sees), empty };
    if (anisotropy) {
      // Beyond this, anisotropy adds what makes a node visible; those that are so without it ask for nothing.
      const needed = table.map((value) => (value > macro.limit ? -1 : ((macro.limit - value) / BAND_2_NORM) ** 2));
      const nodes = anisotropy.exceeding(from, end, codes, needed);
      seen = { codes: nodes, first: from, table: Uint8Array.of(0, 1), empty };
    }
    macro.mark(seenBricks(blocks, edge, [from, to], seen), blocks.places.slice(from, to));
    if (plan.texels.density === "beside") return null;
    const own = codes.subarray(0, (to - from) * edge ** 3);
    if (plan.texels.density === "codes") return own.slice() as Uint8Array;
    return plan.texels.density === "halves" ? Uint16Array.from(own, (code) => toHalf(table[code])) : Float32Array.from(own, (code) => table[code]);
  }

  /**
   * Marks of macro cells set by the parts so far, to combine with those of others; null if the level has no density.
   */
  get marks(): Uint8Array | null {
    return this.stored.density ? this.macro.marks : null;
  }

  /**
   * The level's entry, after parts of all blocks have set `marks`. With `isFraming`, includes the visible part of the
   * level. `slotOf` is null for blocks without a slot.
   */
  entry(marks: Uint8Array | null, isFraming: boolean, slotOf: (frame: number) => number | null = (frame) => this.plan.firstSlot[this.number] + frame): LevelEntry {
    const { metadata, number, plan } = this;
    const table = this.table(slotOf);
    const skips = marks ? boxesReading(metadata, number).map((box) => ({ box, distances: this.macro.skipDistances(marks, box) })) : [];
    const inner = skips.find(({ box }) => box === 0)?.distances;
    const counts = macroCounts(metadata, 0);
    const occupied = isFraming && inner ? occupiedShares(inner, counts) : null;
    // Coarse levels fill what is free; the finest one that comes is as good as it gets.
    const least = number === plan.finest ? 1 : Math.max(1, Math.min(...counts) / FREE_ENOUGH);
    return { part: number, table, skips, occupied, free: inner && isNested(metadata) ? freePlace(inner, counts, least) : null };
  }

  /** The table of the level's blocks. */
  table(slotOf: (frame: number) => number | null): Uint32Array {
    return this.blocks.table((frame) => {
      const slot = slotOf(frame);
      return slot === null ? null : (slotPlace(this.plan, slot).map((place) => place * this.plan.slot) as Triple);
    });
  }

  /** All colours, for inherited blocks of the next finer level. */
  colors(): LevelColors {
    const { stored } = this;
    const colors = this.groups.filter(({ kind }) => isColor(kind));
    const all = colors.map((group): [string, Colors] => {
      const { encoding, channels } = group;
      const { codes } = group.window(0, this.blocks.places.length);
      return [group.kind, { level: stored, frames: this.blocks.frames, encoding, codes, channels }];
    });
    return Object.fromEntries(all);
  }
}

/** The norm of the functions of band 2, which is the same in every direction. */
const BAND_2_NORM = Math.sqrt(5 / (4 * Math.PI));

/** One group of a level's channels, with a window of its codes. */
class Group {
  readonly encoding: Encoding;
  readonly channels: number;
  readonly name: string;
  private readonly table: Float64Array | null;
  /** The codes as half floats, once requested. */
  private halves: Uint16Array | null = null;
  /** Number of codes per frame. */
  private readonly size: number;
  /** Codes of the frames `[first, end)`, with room after them. */
  private codes: Codes | null = null;
  private first = 0;
  private end = 0;
  /** Whether the codes are those of all frames and stay in memory. */
  private isWhole = false;

  constructor(
    readonly kind: string,
    private readonly atlas: Atlas,
    private readonly bytes: Uint8Array,
    /** Converts a value to the one that the device interpolates. */
    readonly map: Value,
  ) {
    ({ encoding: this.encoding, channels: this.channels, name: this.name } = atlas);
    this.size = atlas.channels * atlas.edge ** 3;
    this.table = valueTable(this.encoding, this.name, map);
  }

  decode(from: number, to: number): { first: number; codes: Codes } {
    return CODINGS[this.kind].decode(this.atlas, this.bytes, from, to);
  }

  share(from: number, to: number): Uint8Array {
    return CODINGS[this.kind].share(this.atlas, this.bytes, from, to);
  }

  /**
   * Codes of the frames `[from, to)`, and the interpolated value for each code. If there are too many different codes
   * for a table, nodes have indices of their own instead.
   */
  looked(from: number, to: number): { codes: Codes; table: Float64Array } {
    const { codes } = this.window(from, to);
    if (this.table) return { codes, table: this.table };
    const value = values(this.encoding, this.name, this.map);
    return { codes: Uint32Array.from(codes, (_, node) => node), table: Float64Array.from(codes, value) };
  }

  /** The channels of the frames `[from, to)`. */
  lanes(from: number, to: number): Lane[] {
    const { channels, size } = this;
    const { codes, table } = this.looked(from, to);
    const halves = this.table ? (this.halves ??= Uint16Array.from(table, toHalf)) : Uint16Array.from(table, toHalf);
    return Array.from({ length: channels }, (_, channel) => ({ codes, start: (channel * size) / channels, stride: size, table: halves }));
  }

  /**
   * For anisotropy: 1 for each node whose sum of squared values exceeds the value that is `needed` for its code of
   * density.
   */
  exceeding(from: number, to: number, densities: Codes, needed: Float64Array): Uint8Array {
    const { channels, size } = this;
    const { codes, table } = this.looked(from, to);
    const [nodes, squares] = [size / channels, table.map((value) => value * value)];
    const out = new Uint8Array(densities.length);
    for (let at = 0, node = 0; at < codes.length; at += size) {
      for (let code = at, end = at + nodes; code < end; code++, node++) {
        let left = needed[densities[node]];
        for (let channel = 0, own = code; channel < channels && left >= 0; channel++, own += nodes) left -= squares[codes[own]];
        if (left < 0) out[node] = 1;
      }
    }
    return out;
  }

  give(codes: Codes): void {
    [this.codes, this.first, this.end, this.isWhole] = [codes, 0, codes.length / this.size, true];
  }

  /**
   * Codes of the frames `[from, to)`, the first of which is `first`. Requests come in order and may overlap. Codes stay
   * valid until the next request.
   */
  window(from: number, to: number): { codes: Codes; first: number } {
    const { size } = this;
    if (!this.codes || (!this.isWhole && (from < this.first || from > this.end))) {
      const { codes, first } = this.decode(from, to);
      [this.codes, this.first, this.end] = [codes, first, first + codes.length / size];
    } else if (to > this.end) {
      const { codes } = this.decode(this.end, to);
      const kept = (this.end - from) * size;
      this.codes = withRoom(this.codes, (from - this.first) * size, kept, codes.length);
      this.codes.set(codes, kept);
      [this.first, this.end] = [from, this.end + codes.length / size];
    }
    return { codes: this.codes.subarray((from - this.first) * size, (to - this.first) * size), first: from };
  }
}

/**
 * Moves the codes of `kept` nodes from `start` on to the front of an array with room for `more`; reuses the array if it
 * is large enough.
 */
function withRoom(codes: Codes, start: number, kept: number, more: number): Codes {
  if (kept + more <= codes.length) return codes.copyWithin(0, start, start + kept);
  const larger = new (codes.constructor as new (length: number) => Codes)(Math.ceil(ROOM * (kept + more)));
  larger.set(codes.subarray(start, start + kept));
  return larger;
}
