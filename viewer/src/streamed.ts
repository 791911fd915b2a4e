/** A baked field on its way from a file to a device, whatever framework draws it. */

import { Decoder } from "./decoder.js";
import { deviceLimits } from "./device.js";
import { FieldError, REMEDY } from "./errors.js";
import type { Metadata } from "./format/metadata.js";
import { isNested } from "./format/parts.js";
import type { Opened } from "./load/loader.js";
import type { Reply } from "./load/messages.js";
import type { OwnSource, RequestOptions, Source } from "./load/source.js";
import { Atlas } from "./render/atlas.js";
import { WIDEST_LAYER } from "./render/network.js";
import type { TextureDevice } from "./render/textureDevice.js";
import type { Textures } from "./render/textures.js";

/** The steps of loading. */
export interface FieldEvents {
  /** Header, metadata and network are there. */
  opened: { metadata: Metadata };
  /** More bytes have arrived. */
  progress: { arrived: number };
  /** The picture has changed: a level came, or a part of one. Draw again. */
  change: {};
  /** All levels are there. */
  done: {};
  /** Loading ended with an error; what was there before keeps being shown. */
  failed: { error: FieldError };
}

/** The object of a framework that shows a field. */
export interface Owner {
  /** Builds what draws the field. */
  begin(opened: Opened): void;
  tell<Kind extends keyof FieldEvents>(kind: Kind, event: FieldEvents[Kind]): void;
}

/** How an address is asked for. */
export interface FieldOptions {
  /** Sent with every request. */
  headers?: HeadersInit;
  credentials?: RequestCredentials;
}

/** Files from this size on are decoded by several workers, and by how many at most. */
const [HELPED_BYTES, MOST_HELPERS] = [1 << 20, 16];

/** One field of all objects that show it, on every device that they are drawn with. */
export class StreamedField {
  /** Resolves once the metadata is there; rejects where it cannot be. */
  readonly opened: Promise<Metadata>;
  /** Resolves once every level is there. */
  readonly finished: Promise<void>;
  /** Bytes that have arrived. */
  arrived = 0;
  private readonly owners = new Set<Owner>();
  private content: Opened | null = null;
  /** What each device has, or will have; the first waits for the device that it is for. */
  private atlases: Atlas[] = [];
  private occupied: [number[], number[]] | null = null;
  /** The middle of a world's free space, as shares of its innermost box. */
  private freeShare: number[] | null = null;
  private readonly worker = new Decoder();
  /** Workers that help the first to decode. */
  private readonly helpers: Decoder[] = [];
  /** How often levels were asked for again. */
  private round = 0;
  private failure: FieldError | null = null;
  /** Keeps the promises, or breaks those that are not kept yet. */
  private readonly keep: { opened: (metadata: Metadata) => void; finished: () => void; reject: (error: FieldError) => void };

  /** Loads `source`, the address of a container or its bytes; nothing is told before an owner joins. */
  constructor(source: Source, { headers, credentials }: FieldOptions = {}) {
    const own = ownSource(source);
    const opened = promise<Metadata>();
    const finished = promise<void>();
    [this.opened, this.finished] = [opened.promise, finished.promise];
    const reject = (error: FieldError) => {
      opened.reject(error);
      finished.reject(error);
    };
    this.keep = { opened: opened.resolve, finished: finished.resolve, reject };
    this.worker.onerror = (error) => {
      this.terminate();
      this.atlases.forEach((atlas) => atlas.expectNothing());
      this.fail(error);
    };
    this.worker.onmessage = (reply) => {
      try {
        this.take(reply);
      } catch (error) {
        this.terminate();
        this.fail(error instanceof FieldError ? error : new FieldError(String(error)));
      }
    };
    const request: RequestOptions = { ...(headers && { headers: Object.fromEntries(new Headers(headers)) }), ...(credentials && { credentials }) };
    deviceLimits().then(
      (device) => this.worker.post({ kind: "load", source: own, request, device }),
      (error) => {
        this.terminate();
        this.fail(error);
      },
    );
  }

  /** Shows the field to one more owner. */
  join(owner: Owner): void {
    this.owners.add(owner);
    if (this.content) owner.begin(this.content);
    const { failure } = this;
    if (failure) queueMicrotask(() => this.owners.has(owner) && owner.tell("failed", { error: failure }));
  }

  /** Ends loading and frees the devices' memory when the last owner leaves. */
  leave(owner: Owner): void {
    if (!this.owners.delete(owner) || this.owners.size > 0) return;
    this.terminate();
    this.keep.reject(new FieldError("The field was given up before all of it was there.", REMEDY.again));
    this.failure = new FieldError("The field was given up.", REMEDY.again);
    this.free();
  }

  private take(reply: Reply): void {
    if (reply.kind === "failed") {
      // Levels that came before are shown, and may have to come again.
      if (!this.content) this.terminate();
      this.atlases.forEach((atlas) => atlas.expectNothing());
      this.fail(new FieldError(reply.message, reply.remedy));
    } else if (reply.kind === "opened") {
      this.begin(reply.opened);
      this.keep.opened(reply.opened.metadata);
      this.tell("opened", { metadata: reply.opened.metadata });
    } else if (reply.kind === "progress") {
      this.arrived = reply.arrived;
      this.tell("progress", { arrived: reply.arrived });
    } else if (reply.kind === "done") {
      this.endHelpers();
      this.keep.finished();
      this.tell("done", {});
    } else if (reply.kind === "entry") {
      this.occupied ??= reply.entry.occupied;
      this.freeShare ??= reply.entry.free;
      for (const atlas of this.wanting(reply.round)) atlas.finish(reply.entry);
      this.tell("change", {});
    } else if (reply.kind === "begun") {
      for (const atlas of this.wanting(reply.round)) atlas.expect(reply.part);
    } else if (reply.kind === "part") {
      for (const atlas of this.wanting(reply.round)) atlas.add(reply.part);
    }
  }

  /** The devices that what was asked for in a round is for: those that have not got everything yet. */
  private wanting(round: number): Atlas[] {
    return round === this.round ? this.atlases.filter((atlas) => !atlas.isWhole) : [];
  }

  /** What is in the file; null until it is opened. */
  get file(): Opened | null {
    return this.content;
  }

  /** The finest level that any device shows; null before the first picture. */
  get finest(): number | null {
    const levels = this.atlases.flatMap(({ finest }) => finest ?? []);
    return levels.length > 0 ? Math.min(...levels) : null;
  }

  /** Whether levels have come that `upload` will bring to a device. */
  get waiting(): boolean {
    return this.atlases.some((atlas) => atlas.waiting);
  }

  /** Whether a level's bytes are there and are being decoded. */
  get decoding(): boolean {
    return this.atlases.some((atlas) => atlas.decoding);
  }

  /** What a device has, and the finest level that it shows; null before the first upload to it. */
  on(device: TextureDevice): { textures: Textures | null; finest: number | null } | null {
    return this.atlases.find((atlas) => atlas.device === device) ?? null;
  }

  /**
   * Two corners, in local axes, between which something is to be seen; those of the box before the first level. A world, which is
   * seen from inside, has all of its innermost box.
   */
  get visible(): [number[], number[]] {
    const all: [number[], number[]] = [[0, 0, 0], [1, 1, 1]];
    const [low, high] = this.content && isNested(this.content.metadata) ? all : (this.occupied ?? all);
    return [this.placeOf(low), this.placeOf(high)];
  }

  /** In local axes, the middle of a world's free space; that of the innermost box where it is not known. */
  get standpoint(): number[] {
    return this.placeOf(this.freeShare ?? [0.5, 0.5, 0.5]);
  }

  /** Of a place as shares of the innermost box, that in local axes. */
  private placeOf(share: number[]): number[] {
    if (!this.content) return [0, 0, 0];
    const { min, max } = this.content.metadata.bounds;
    return share.map((share, axis) => min[axis] + share * (max[axis] - min[axis]));
  }

  /** Brings decoded blocks to a device, for a few milliseconds. Whether the picture has changed. */
  upload(device: TextureDevice): boolean {
    if (!this.content) return false;
    const atlas = this.atlasOf(device, this.content);
    const before = atlas.live.size;
    if (!atlas.upload(device)) {
      this.round++;
      this.worker.post({ kind: "again" });
    }
    const isChanged = atlas.live.size !== before;
    if (atlas.waiting || isChanged) this.tell("change", {});
    return isChanged;
  }

  private atlasOf(device: TextureDevice, opened: Opened): Atlas {
    let atlas = this.atlases.find((atlas) => atlas.device === device) ?? this.atlases.find((atlas) => atlas.device === null);
    if (!atlas) {
      // What came before this device was there has to come again.
      atlas = new Atlas(opened, (error) => this.refuse(error), false);
      this.atlases.push(atlas);
    }
    return atlas;
  }

  /** Builds what does not depend on levels. */
  private begin(opened: Opened): void {
    const widest = Math.max(0, ...opened.network.flatMap((layer) => [layer.inputs, layer.outputs]));
    if (widest > WIDEST_LAYER) throw new FieldError(`The network has a layer of ${widest} values; this viewer takes ${WIDEST_LAYER}.`, REMEDY.newer);
    this.owners.forEach((owner) => owner.begin(opened));
    this.atlases = [new Atlas(opened, (error) => this.refuse(error), true)];
    this.content = opened;
    if (opened.fileBytes >= HELPED_BYTES) this.startHelpers();
  }

  /** A device has no room. */
  private refuse(error: FieldError): void {
    this.terminate();
    this.free();
    this.fail(error);
  }

  private free(): void {
    this.atlases.forEach((atlas) => atlas.dispose());
    [this.atlases, this.content] = [[], null];
  }

  /** Starts as many decoders as the device has cores, beside the one that reads. */
  private startHelpers(): void {
    const ports = Array.from({ length: Math.min(MOST_HELPERS, navigator.hardwareConcurrency) }, (_, number) => {
      const { port1, port2 } = new MessageChannel();
      const helper = new Decoder();
      // The others do without one that does not start, or says why it cannot.
      helper.onerror = helper.onmessage = () => this.worker.post({ kind: "left", helper: number });
      this.helpers.push(helper);
      helper.post({ kind: "help", port: port2 }, [port2]);
      return port1;
    });
    this.worker.post({ kind: "crew", ports }, ports);
  }

  /** After all levels have come once, the first decoder does what may have to be done again: a lost device is rare. */
  private endHelpers(): void {
    this.helpers.splice(0).forEach((helper, number) => {
      helper.terminate();
      this.worker.post({ kind: "left", helper: number });
    });
  }

  private terminate(): void {
    for (const worker of [this.worker, ...this.helpers]) worker.terminate();
  }

  private fail(error: FieldError): void {
    this.failure = error;
    this.keep.reject(error);
    this.tell("failed", { error });
  }

  private tell<Kind extends keyof FieldEvents>(kind: Kind, event: FieldEvents[Kind]): void {
    for (const owner of [...this.owners]) owner.tell(kind, event);
  }
}

/** A source as the worker takes it. A blob's bytes are not copied on their way. */
function ownSource(source: Source): OwnSource {
  if (typeof source === "string") return new URL(source, document.baseURI).href;
  if (source instanceof Blob) return source;
  // Whoever calls from plain script may hand over anything.
  if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return new Blob([source]);
  throw new FieldError("A field is made of a container's address, of its bytes, or of another field.", REMEDY.source);
}

/** A promise to be kept elsewhere; nobody has to listen to its failure. */
function promise<T>(): { promise: Promise<T>; resolve: (value: T) => void; reject: (error: FieldError) => void } {
  let resolve!: (value: T) => void;
  let reject!: (error: FieldError) => void;
  const made = new Promise<T>((yes, no) => ([resolve, reject] = [yes, no]));
  made.catch(() => {});
  return { promise: made, resolve, reject };
}
