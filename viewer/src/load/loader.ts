/**
 * Reads a container coarse to fine: header and directory, metadata, then level after level as bytes arrive. Runs in a
 * worker.
 */

import { FieldError } from "../errors.js";
import { checkContents } from "../format/contents.js";
import { FEATURES } from "../format/generated.js";
import { chunkBytes, type Entry, ENTRY_BYTES, HEADER_BYTES, paddedEnd, readDirectory, readHeader } from "../format/layout.js";
import { type Mask, readMask } from "../format/mask.js";
import { type Metadata, networkOf, readMetadata, requiredFeatures } from "../format/metadata.js";
import { inheritedFrom, partsFrom, partsOf, partsOfLevel } from "../format/parts.js";
import { type Layer, readNetwork } from "../format/network.js";
import { Crew, decodeShares } from "./crew.js";
import { type DecodedPart, levelChunks, type LevelColors, LevelDecoder, levelEntries, type LevelEntry } from "./level.js";
import { type DeviceLimits, type Plan, plan } from "./plan.js";
import { type Change, type Look, resident, Residents, runsOf } from "./residents.js";
import { type ByteSource, openSource, type OwnSource, type RequestOptions, type Transfer } from "./source.js";

/** Length of the first request: header and directory of any container with a usual number of levels. */
const FIRST_BYTES = 4096;
/** Levels up to this share of the file are part of the first picture. */
const FIRST_PICTURE = 1 / 25;

/**
 * Up to this many unrequested blocks between two requested ones are decoded with them, because they may share a run.
 */
const BRIDGED = 64;

/** Data known before the first level. */
export interface Opened {
  metadata: Metadata;
  plan: Plan;
  network: Layer[];
  mask: Mask | null;
  /** Size of the complete file in bytes. */
  fileBytes: number;
  /** The finest level in the file; not 0 if the file is a prefix of a container. */
  available: number;
  /** Bytes from the start of the file that suffice to render each level, fine to coarse. */
  prefixes: number[];
  transfer: Transfer;
}

/** Callbacks during loading. */
export interface Listener {
  opened(opened: Opened): void;
  progress(arrived: number): void;
  /** The bytes of a level or a shell have arrived; its blocks will follow. */
  begun(part: number, round: number): void;
  /** Blocks of a level or a shell, in any order. `round` counts the calls of `again`. */
  part(part: DecodedPart, round: number): void;
  /** All blocks of a part have arrived, or its blocks have new slots. */
  entry(entry: LevelEntry, round: number): void;
  /** If not all blocks fit: how many blocks fit, how many have arrived, and whether this answers a `look`. */
  residents(held: number, known: number, isAnswer: boolean): void;
}

/** Levels and shells that arrive together: bytes of the file from `start` on. */
interface Piece {
  parts: number[];
  bytes: Uint8Array;
  start: number;
  /** Colours of the level before, if the first one has inherited blocks. */
  coarser: LevelColors | null;
}

/** Loads one container. */
export class Loader {
  private readonly source: ByteSource;
  private entries: Entry[] = [];
  private opened: Opened | null = null;
  readonly crew = new Crew();
  /** Decoded data, kept to be decoded again if the device loses it. */
  private readonly kept: Piece[] = [];
  private round = 0;
  /** Whether a level has reported the visible part of the field. */
  private isFramed = false;
  /** If not all blocks fit: the resident ones, the decoders of others, and the skip distances found. */
  private residents: Residents | null = null;
  private readonly decoders = new Map<number, { decoder: LevelDecoder; entry: LevelEntry }>();
  /** The work in progress and waiting. */
  private queue: Promise<unknown> = Promise.resolve();

  constructor(
    source: OwnSource,
    request: RequestOptions,
    private readonly listener: Listener,
  ) {
    this.source = openSource(source, request);
  }

  /** Loads every level that fits the device. */
  async load(device: DeviceLimits): Promise<void> {
    try {
      await this.levels(device);
    } finally {
      // What does not fit is not wanted, nor is what follows an error.
      this.source.cancel();
    }
  }

  private async levels(device: DeviceLimits): Promise<void> {
    const head = await this.open(device);
    const { opened, listener } = this;
    if (!opened) return;
    let loaded = head.length;
    // Bytes of the file from `start` on that no level has taken yet.
    let rest: Uint8Array = head;
    let start = 0;
    let coarser: LevelColors | null = null;
    for (const parts of this.pieces(opened)) {
      const end = this.end(parts[parts.length - 1]);
      const bytes = joined(rest, await this.source.read(loaded, end, listener.progress));
      loaded = start + bytes.length;
      if (loaded < end) throw new FieldError(`The file ends after ${loaded} bytes and should have ${opened.fileBytes}.`);
      const piece: Piece = { parts, bytes, start, coarser };
      coarser = await this.inTurn(async () => {
        for (;;) {
          const { round } = this;
          const colors = await this.decode(opened, piece);
          // What the device lost meanwhile has to come once more.
          if (round !== this.round) continue;
          this.kept.push(piece);
          return colors;
        }
      });
      [rest, start] = [bytes.subarray(end - start), end];
    }
  }

  /** Stops loading. Loaded data stays. */
  stop(): void {
    this.source.cancel();
  }

  /** Decodes the loaded data again. */
  async again(): Promise<void> {
    const { opened } = this;
    this.round++;
    const pieces = [...this.kept];
    await this.inTurn(async () => {
      for (const piece of pieces) if (opened) await this.decode(opened, piece);
    });
  }

  /** Runs work one after the other. */
  private inTurn<T>(work: () => Promise<T>): Promise<T> {
    const done = this.queue.then(work);
    this.queue = done.catch(() => {});
    return done;
  }

  /** Decodes a piece. Returns the colours for the next one's inherited blocks. */
  private async decode(opened: Opened, { parts, bytes, start, coarser }: Piece): Promise<LevelColors | null> {
    const { metadata, plan } = opened;
    const { round, listener, residents } = this;
    const part = (part: DecodedPart) => {
      const shown = residents ? resident(part, plan, (block) => residents.slotOf(part.part, block)) : part;
      if (shown) listener.part(shown, round);
    };
    let colors = coarser;
    const all = partsOf(metadata);
    for (const number of parts) {
      listener.begun(number, round);
      const chunks = levelChunks(this.entries, number, bytes, start, metadata.levels.length);
      const decoder = new LevelDecoder(metadata, plan, number, chunks, colors);
      if (residents && !this.decoders.has(number)) {
        residents.add(number, decoder.blocks.places);
        this.move(residents.settle().filter((change) => change.part !== number));
      }
      const { blocks_filled: inherited = 0, blocks_stored: blocks } = all[number];
      const isInherited = all.some(({ blocks_filled }, part) => (blocks_filled ?? 0) > 0 && inheritedFrom(metadata, part) === number);
      const helpers = inherited === 0 ? await this.crew.gather(blocks) : [];
      let { marks } = decoder;
      if (helpers.length > 0) {
        const share = (from: number, to: number) => ({ metadata, plan, number, chunks: decoder.share(from, to), from, to });
        marks = await decodeShares(helpers, blocks, share, part);
      } else {
        for (const one of decoder.parts(0, blocks)) part(one);
      }
      const entry = decoder.entry(marks, !this.isFramed, residents ? (block) => residents.slotOf(number, block) : undefined);
      if (residents) {
        this.decoders.set(number, { decoder, entry });
        listener.residents(...residents.count, false);
      }
      this.isFramed ||= entry.occupied !== null;
      listener.entry(entry, round);
      // A shell comes between a level and those that inherit from it.
      if (number < metadata.levels.length) colors = isInherited ? decoder.colors() : null;
    }
    return colors;
  }

  /** Moves the camera, given in the field's axes. If not all blocks fit, those near the camera get slots. */
  async look(camera: Look): Promise<void> {
    const { residents, listener } = this;
    if (!residents) return;
    residents.look(camera);
    await this.inTurn(async () => {
      this.move(residents.settle());
      listener.residents(...residents.count, true);
    });
  }

  /** Uploads blocks that have new slots to the device. */
  private move(changes: Change[]): void {
    const { listener, round, residents, decoders } = this;
    if (!residents) return;
    const enter = (part: number, slotOf: (block: number) => number | null) => {
      const known = decoders.get(part);
      if (known) listener.entry({ part, table: known.decoder.table(slotOf), skips: [], occupied: null, free: null }, round);
    };
    // Nobody may look for what was in a slot while something else comes into it.
    for (const { part, gained, hasLost } of changes) {
      if (!hasLost) continue;
      const fresh = new Set(gained);
      enter(part, (block) => (fresh.has(block) ? null : residents.slotOf(part, block)));
    }
    for (const { part, gained } of changes) {
      const known = decoders.get(part);
      if (!known || gained.length === 0) continue;
      const fresh = new Set(gained);
      for (const [from, to] of runsOf(gained, BRIDGED)) {
        for (const one of known.decoder.parts(from, to)) {
          const shown = resident(one, this.opened!.plan, (block) => (fresh.has(block) ? residents.slotOf(part, block) : null));
          if (shown) listener.part(shown, round);
        }
      }
      enter(part, (block) => residents.slotOf(part, block));
    }
  }

  /** Reads header, directory and the chunks of no level before the first level. Returns all bytes read. */
  private async open(device: DeviceLimits): Promise<Uint8Array> {
    const { listener } = this;
    let bytes: Uint8Array = await this.source.read(0, FIRST_BYTES, listener.progress);
    const more = async (end: number) => {
      if (end > bytes.length) bytes = joined(bytes, await this.source.read(bytes.length, end, listener.progress));
    };
    const header = readHeader(bytes);
    await more(HEADER_BYTES + ENTRY_BYTES * header.chunks);
    this.entries = readDirectory(header, bytes);
    // All that the first picture takes in one request.
    await more(this.firstEnd(header.fileBytes));
    const [meta] = this.entries;
    if (meta.kind !== "META") throw new FieldError("The first chunk is not the metadata.");
    await more(meta.offset + meta.bytes);
    const metadata = readMetadata(chunkBytes(meta, bytes, 0));
    const asked = requiredFeatures(metadata);
    const odd = FEATURES.filter((feature) => header.features.has(feature) !== asked.has(feature));
    if (odd.length > 0) throw new FieldError(`Header and metadata disagree whether ${odd.join(" and ")} are required.`);
    checkContents(this.entries, metadata, header);
    const prefixes = metadata.levels.map((_, level) => this.prefix(level));
    const available = this.available(prefixes, header.fileBytes);
    const first = this.find("TABL", partsFrom(metadata, 0)[0]);
    // All that is not of a level lies before the coarsest one, or is not needed.
    const body = async (kind: string) => {
      const entry = this.find(kind, null);
      if (!entry || entry.offset > (first?.offset ?? 0)) throw new FieldError(`Chunk ${kind} is missing, or lies behind levels.`);
      await more(entry.offset + entry.bytes);
      return chunkBytes(entry, bytes, 0);
    };
    const shape = networkOf(metadata);
    const network = shape ? readNetwork(shape, await body("VMLP")) : [];
    const mask = metadata.free_space ? readMask(await body("MASK")) : null;
    const maskBytes = mask ? mask.values.byteLength : 0;
    const laidOut = plan(metadata, device, available, maskBytes);
    if (laidOut.isPartial) this.residents = new Residents(metadata, laidOut);
    const { fileBytes } = header;
    this.opened = { metadata, plan: laidOut, network, mask, fileBytes, available, prefixes, transfer: this.source.transfer };
    listener.opened(this.opened);
    return bytes;
  }

  /** The finest level of a file that may be a prefix of a container. The file must end after a level. */
  private available(prefixes: number[], fileBytes: number): number {
    const { length } = this.source;
    if (length === null || length === fileBytes) return 0;
    // A level that ends before the prefix of a coarser one is whole, too.
    if (prefixes.includes(length)) return prefixes.findIndex((prefix) => prefix <= length);
    throw new FieldError(`The file has ${length} bytes, which is not where a level ends; its header says ${fileBytes}.`);
  }

  /** Levels, with their shells, that arrive together, coarsest first. */
  private *pieces({ metadata, plan, fileBytes }: Opened): Generator<number[]> {
    // Levels that render with the finest one only come with it.
    const together = metadata.levels.some(({ density }) => density === null);
    let parts: number[] = [];
    for (let level = metadata.levels.length - 1; level >= plan.finest; level--) {
      parts.push(...partsOfLevel(metadata, level));
      if (level > plan.finest && (together || this.end(level - 1) <= fileBytes * FIRST_PICTURE)) continue;
      yield parts;
      parts = [];
    }
  }

  private find(kind: string, part: number | null): Entry | undefined {
    return this.entries.find((entry) => entry.kind === kind && entry.part === part);
  }

  /**
   * Bytes from the start of the file that suffice to decode a part: its prefix may contain unknown chunks after those
   * of finer parts.
   */
  private end(part: number): number {
    return Math.max(0, ...levelEntries(this.entries, part).map(paddedEnd));
  }

  /** End of the levels and shells of the first picture, as far as the directory is known. */
  private firstEnd(fileBytes: number): number {
    const ends = [...new Set(this.entries.flatMap(({ part }) => part ?? []))].map((part) => this.end(part));
    const { length } = this.source;
    return Math.min(length ?? fileBytes, Math.max(Math.min(...ends), ...ends.filter((end) => end <= fileBytes * FIRST_PICTURE)));
  }

  private prefix(level: number): number {
    return this.find("TABL", level)?.prefix ?? 0;
  }
}

function joined(a: Uint8Array, b: Uint8Array): Uint8Array {
  if (a.length === 0) return b;
  if (b.length === 0) return a;
  const both = new Uint8Array(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}
