/** Loads a baked field from a file to a device, independent of the framework that draws it. */

import { Decoder } from "./decoder.js";
import { deviceLimits } from "./device.js";
import { FieldError, REMEDY } from "./errors.js";
import type { Metadata } from "./format/metadata.js";
import { extentOf, isNested, partsOf } from "./format/parts.js";
import type { Budget, FieldEvents, FieldOptions, Manager, Owner } from "./fieldOptions.js";
import type { Opened } from "./load/loader.js";
import type { Reply } from "./load/messages.js";
import type { Look } from "./load/residents.js";
import type { OwnSource, RequestOptions, Source } from "./load/source.js";
import { Atlas } from "./render/atlas.js";
import { WIDEST_LAYER } from "./render/network.js";
import type { TextureDevice } from "./render/textureDevice.js";
import type { Textures } from "./render/textures.js";
import { lookOf, type View } from "./render/uniforms.js";

/**
 * Movement of the camera after which other blocks may be close, as a share of the diagonal of the innermost box; and
 * rotation in radians after which it sees others.
 */
const [MOVED, TURNED] = [0.01, 0.1];

/** Files of at least this size are decoded by several workers; and the maximum number of helpers. */
const [HELPED_BYTES, MOST_HELPERS] = [1 << 20, 16];

/** One field, for all objects that show it and all devices that draw them. */
export class StreamedField {
  /** Resolves when the metadata is available; rejects if it cannot be loaded. */
  readonly opened: Promise<Metadata>;
  /** Resolves when every level is loaded. */
  readonly finished: Promise<void>;
  /** Number of bytes received. */
  arrived = 0;
  private readonly owners = new Set<Owner>();
  /** Receivers of the same events as owners, which do not keep the field alive. */
  private readonly watchers = new Set<Owner>();
  /** Whether loading has ended, and whether the field is no longer needed. */
  private isDone = false;
  private isGivenUp = false;
  private content: Opened | null = null;
  /** The data on each device, present or expected. The first one waits for its device. */
  private atlases: Atlas[] = [];
  private occupied: [number[], number[]] | null = null;
  /** The centre of a world's free space, as fractions of its innermost box. */
  private freeShare: number[] | null = null;
  /** If not all blocks fit: number of blocks that do, and of all that have arrived. */
  private held: [number, number] | null = null;
  /** The camera; the one last sent to the decoder, and whether the answer is pending. */
  private camera: Look | null = null;
  private told: Look | null = null;
  private isLooking = false;
  private readonly worker = new Decoder();
  /** Workers that help the first one to decode. */
  private readonly helpers: Decoder[] = [];
  /** How often levels were requested again, and how many of these requests are pending. */
  private round = 0;
  private unanswered = 0;
  private failure: FieldError | null = null;
  /** Resolves the promises, or rejects those that are pending. */
  private readonly keep: { opened: (metadata: Metadata) => void; finished: () => void; reject: (error: unknown) => void };

  /** Loads `source`, the address of a container or its bytes. No events are sent before an owner joins. */
  constructor(source: Source, { headers, credentials, maxBytes = Infinity, signal, manager }: FieldOptions = {}) {
    const own = ownSource(source, manager);
    this.count(own, manager);
    const opened = promise<Metadata>();
    const finished = promise<void>();
    [this.opened, this.finished] = [opened.promise, finished.promise];
    const reject = (error: unknown) => {
      opened.reject(error);
      finished.reject(error);
    };
    this.keep = { opened: opened.resolve, finished: finished.resolve, reject };
    this.worker.onerror = (error) => {
      this.terminate();
      this.atlases.forEach((atlas) => atlas.expectNothing());
      this.unanswered = 0;
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
    if (signal?.aborted) this.abort(signal.reason);
    else signal?.addEventListener("abort", () => this.abort(signal.reason), { once: true });
    Promise.all([deviceLimits(), own]).then(
      ([device, own]) => this.worker.post({ kind: "load", source: own, request, device: { ...device, bytes: Math.min(device.bytes, maxBytes) } }),
      (error) => {
        this.terminate();
        this.fail(error);
      },
    );
  }

  /** Notifies a manager when loading begins, and when the first level is loaded or will not arrive. */
  private count(source: OwnSource | Promise<OwnSource>, manager: Manager | undefined): void {
    if (!manager) return;
    const name = typeof source === "string" ? source : "radiance field";
    manager.itemStart(name);
    const owner: Owner = {
      begin: () => {},
      tell: (kind) => {
        if (kind !== "change" && kind !== "failed") return;
        this.watchers.delete(owner);
        if (kind === "failed") manager.itemError(name);
        manager.itemEnd(name);
      },
    };
    this.watchers.add(owner);
  }

  /** Cancels loading. */
  private abort(reason: unknown): void {
    if (this.isDone) return;
    if (this.content) this.worker.post({ kind: "stop" });
    else this.terminate();
    this.isDone = this.isGivenUp = true;
    this.keep.reject(reason);
    this.fail(new FieldError("Loading was given up.", REMEDY.again));
  }

  /** Number of bytes to load; 0 until known. */
  private get total(): number {
    const { content } = this;
    return content ? Math.max(content.prefixes[content.plan.finest], content.plan.finest === 0 ? content.fileBytes : 0, this.arrived) : 0;
  }

  /** Adds an owner that shows the field. */
  join(owner: Owner): void {
    this.owners.add(owner);
    if (this.content) owner.begin(this.content);
    const { failure } = this;
    if (failure) queueMicrotask(() => this.owners.has(owner) && owner.tell("failed", { error: failure }));
  }

  /** Removes an owner. After the last one, loading ends and the device memory is freed. */
  leave(owner: Owner): void {
    if (!this.owners.delete(owner) || this.owners.size > 0) return;
    this.terminate();
    this.keep.reject(new FieldError("The field was given up before all of it was there.", REMEDY.again));
    this.failure = new FieldError("The field was given up.", REMEDY.again);
    for (const watcher of [...this.watchers]) watcher.tell("failed", { error: this.failure });
    this.free();
  }

  private take(reply: Reply): void {
    if (reply.kind === "failed") {
      // It was given up.
      if (this.isGivenUp) return;
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
      this.tell("progress", { loaded: reply.arrived, total: this.total });
    } else if (reply.kind === "done") {
      this.endHelpers();
      this.isDone = true;
      this.keep.finished();
      this.tell("done", {});
    } else if (reply.kind === "entry") {
      this.occupied ??= reply.entry.occupied;
      this.freeShare ??= reply.entry.free;
      for (const atlas of this.wanting(reply.round)) atlas.finish(reply.entry);
      this.tell("change", {});
    } else if (reply.kind === "again") {
      this.unanswered = Math.max(0, this.unanswered - 1);
      this.tell("change", {});
    } else if (reply.kind === "residents") {
      this.held = [reply.held, reply.known];
      if (!reply.isAnswer) return;
      this.isLooking = false;
      this.lookAgain();
    } else if (reply.kind === "begun") {
      for (const atlas of this.wanting(reply.round)) atlas.expect(reply.part);
    } else if (reply.kind === "part") {
      for (const atlas of this.wanting(reply.round)) atlas.add(reply.part);
    }
  }

  /** The devices that still need the data requested in a round. */
  private wanting(round: number): Atlas[] {
    return round === this.round ? this.atlases.filter((atlas) => !atlas.isWhole || this.content?.plan.isPartial) : [];
  }

  /** Contents of the file; null until it is opened. */
  get file(): Opened | null {
    return this.content;
  }

  /** The finest level shown on any device; null before the first picture. */
  get finest(): number | null {
    const levels = this.atlases.flatMap(({ finest }) => finest ?? []);
    return levels.length > 0 ? Math.min(...levels) : null;
  }

  /** Whether loaded levels wait for `upload`. */
  get waiting(): boolean {
    return this.atlases.some((atlas) => atlas.waiting);
  }

  /** Whether the bytes of a level, or blocks near the camera, are being decoded. */
  get decoding(): boolean {
    return this.isLooking || this.unanswered > 0 || this.atlases.some((atlas) => atlas.decoding);
  }

  /** The field's use of memory on each device; null until it is opened. */
  get budget(): Budget | null {
    if (!this.content) return null;
    const { metadata, plan } = this.content;
    const live = this.atlases.map((atlas) => [...atlas.live].reduce((sum, part) => sum + partsOf(metadata)[part].blocks_stored, 0));
    const whole = Math.max(0, ...live);
    return { bytes: plan.bytes, most: plan.most, blocks: plan.isPartial ? (this.held ?? [0, 0]) : [whole, whole] };
  }

  /** Moves the camera. If not all blocks fit, those near the camera are loaded, visible ones first. */
  look(view: View): void {
    if (!this.content?.plan.isPartial) return;
    this.camera = lookOf(view);
    this.lookAgain();
  }

  private lookAgain(): void {
    const { camera, told, content } = this;
    if (!camera || !content || this.isLooking) return;
    const far = MOVED * Math.hypot(...extentOf(content.metadata.bounds));
    const apart = (a: readonly number[], b: readonly number[]) => Math.hypot(...a.map((value, axis) => value - b[axis]));
    if (told && apart(camera.place, told.place) <= far && apart(camera.forward, told.forward) <= TURNED && Math.abs(camera.cosine - told.cosine) <= TURNED) return;
    [this.told, this.isLooking] = [camera, true];
    this.worker.post({ kind: "look", camera });
  }

  /** A device's textures, and the finest level that it shows; null before the first upload to it. */
  on(device: TextureDevice): { textures: Textures | null; finest: number | null } | null {
    return this.atlases.find((atlas) => atlas.device === device) ?? null;
  }

  /**
   * Two corners of the visible part, in local axes; those of the box before the first level. For a world, which is
   * viewed from inside, those of its innermost box.
   */
  get visible(): [number[], number[]] {
    const all: [number[], number[]] = [[0, 0, 0], [1, 1, 1]];
    const [low, high] = this.content && isNested(this.content.metadata) ? all : (this.occupied ?? all);
    return [this.placeOf(low), this.placeOf(high)];
  }

  /** The centre of a world's free space in local axes; that of the innermost box until known. */
  get standpoint(): number[] {
    return this.placeOf(this.freeShare ?? [0.5, 0.5, 0.5]);
  }

  /** Converts fractions of the innermost box to local axes. */
  private placeOf(share: number[]): number[] {
    if (!this.content) return [0, 0, 0];
    const { min, max } = this.content.metadata.bounds;
    return share.map((share, axis) => min[axis] + share * (max[axis] - min[axis]));
  }

  /** Uploads decoded blocks to a device, for a few milliseconds. Returns whether the picture has changed. */
  upload(device: TextureDevice): boolean {
    if (!this.content) return false;
    const atlas = this.atlasOf(device, this.content);
    const before = atlas.entered;
    if (!atlas.upload(device)) {
      this.round++;
      this.unanswered++;
      this.worker.post({ kind: "again" });
    }
    const isChanged = atlas.entered !== before;
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

  /** Builds everything that does not depend on levels. */
  private begin(opened: Opened): void {
    const widest = Math.max(0, ...opened.network.flatMap((layer) => [layer.inputs, layer.outputs]));
    if (widest > WIDEST_LAYER) throw new FieldError(`The network has a layer of ${widest} values; this viewer takes ${WIDEST_LAYER}.`, REMEDY.newer);
    this.owners.forEach((owner) => owner.begin(opened));
    this.atlases = [new Atlas(opened, (error) => this.refuse(error), true)];
    this.content = opened;
    if (opened.fileBytes >= HELPED_BYTES) this.startHelpers();
  }

  /** Reports that a device has no room. */
  private refuse(error: FieldError): void {
    this.terminate();
    this.free();
    this.fail(error);
  }

  private free(): void {
    this.atlases.forEach((atlas) => atlas.dispose());
    [this.atlases, this.content] = [[], null];
  }

  /** Starts one decoder per core of the machine, besides the main one. */
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

  /**
   * Ends the helpers after all levels have loaded once. The first decoder repeats work if a device is lost, which is
   * rare.
   */
  private endHelpers(): void {
    this.helpers.splice(0).forEach((helper, number) => {
      helper.terminate();
      this.worker.post({ kind: "left", helper: number });
    });
  }

  private terminate(): void {
    this.isLooking = false;
    for (const worker of [this.worker, ...this.helpers]) worker.terminate();
  }

  private fail(error: FieldError): void {
    this.isDone = true;
    this.isLooking = false;
    this.failure = error;
    this.keep.reject(error);
    this.tell("failed", { error });
  }

  private tell<Kind extends keyof FieldEvents>(kind: Kind, event: FieldEvents[Kind]): void {
    for (const owner of [...this.owners, ...this.watchers]) owner.tell(kind, event);
  }
}

/** A source in the form for the worker. The bytes of a blob are not copied. */
function ownSource(source: Source, manager: Manager | undefined): OwnSource | Promise<OwnSource> {
  if (typeof source === "string" || source instanceof URL) {
    const address = String(source);
    return new URL(manager?.resolveURL?.(address) ?? address, document.baseURI).href;
  }
  if (source instanceof Blob) return source;
  if (source instanceof Response) return answered(source);
  // Whoever calls from plain script may hand over anything.
  if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return new Blob([source]);
  throw new FieldError("A field is made of a container's address, of its bytes, of a server's answer, or of another field.", REMEDY.source);
}

async function answered(response: Response): Promise<Blob> {
  if (!response.ok) throw new FieldError(`${response.url || "The server"} answers ${response.status} ${response.statusText}.`, REMEDY.network);
  return response.blob().catch(() => {
    throw new FieldError("The server's answer cannot be read: it was read before, or the connection broke.", REMEDY.network);
  });
}

/** A promise that is resolved elsewhere. Its failure does not have to be handled. */
function promise<T>(): { promise: Promise<T>; resolve: (value: T) => void; reject: (error: unknown) => void } {
  let resolve!: (value: T) => void;
  let reject!: (error: unknown) => void;
  const made = new Promise<T>((yes, no) => ([resolve, reject] = [yes, no]));
  made.catch(() => {});
  return { promise: made, resolve, reject };
}
