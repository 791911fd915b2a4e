/** A baked field on its way from a file to a WebGL 2 context, whatever framework draws it. */

import { startDecoder } from "./decoder.js";
import { deviceLimits } from "./device.js";
import { FieldError, REMEDY } from "./errors.js";
import type { Metadata } from "./format/metadata.js";
import type { Opened } from "./load/loader.js";
import type { Reply, Request } from "./load/messages.js";
import type { Source } from "./load/source.js";
import { Atlas } from "./render/atlas.js";
import { WIDEST_LAYER } from "./render/network.js";
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

/** Files from this size on are decoded by several workers, and by how many at most. */
const [HELPED_BYTES, MOST_HELPERS] = [1 << 20, 16];

export class StreamedField {
  /** Resolves once the metadata is there; rejects where it cannot be. */
  readonly opened: Promise<Metadata>;
  /** Resolves once every level is there. */
  readonly finished: Promise<void>;
  /** Bytes that have arrived. */
  arrived = 0;
  private content: { opened: Opened; atlas: Atlas } | null = null;
  private readonly worker: Worker;
  /** Workers that help the first to decode. */
  private readonly helpers: Worker[] = [];
  /** How often levels were asked for again. */
  private round = 0;
  /** Breaks the promises that are not kept yet. */
  private readonly reject: (error: FieldError) => void;

  /** Loads `source`, the address of a container or its bytes. */
  constructor(
    source: Source,
    private readonly owner: Owner,
  ) {
    this.worker = startDecoder();
    const opened = promise<Metadata>();
    const finished = promise<void>();
    [this.opened, this.finished] = [opened.promise, finished.promise];
    this.reject = (error) => {
      opened.reject(error);
      finished.reject(error);
    };
    this.worker.onerror = () => {
      this.terminate();
      this.content?.atlas.expectNothing();
      this.fail(new FieldError("The decoder could not be started.", REMEDY.decoder));
    };
    this.worker.onmessage = ({ data }: MessageEvent<Reply>) => {
      try {
        if (data.kind === "failed") {
          // Levels that came before are shown, and may have to come again.
          if (!this.content) this.terminate();
          this.content?.atlas.expectNothing();
          this.fail(new FieldError(data.message, data.remedy));
        } else if (data.kind === "opened") {
          this.begin(data.opened);
          opened.resolve(data.opened.metadata);
          owner.tell("opened", { metadata: data.opened.metadata });
        } else if (data.kind === "progress") {
          this.arrived = data.arrived;
          owner.tell("progress", { arrived: data.arrived });
        } else if (data.kind === "begun") {
          if (data.round === this.round) this.content?.atlas.expect(data.level);
        } else if (data.kind === "part") {
          if (data.round === this.round) this.content?.atlas.add(data.part);
        } else if (data.kind === "entry") {
          if (data.round === this.round) this.content?.atlas.finish(data.entry);
          owner.tell("change", {});
        } else if (data.kind === "done") {
          finished.resolve();
          owner.tell("done", {});
        }
      } catch (error) {
        this.terminate();
        this.fail(error instanceof FieldError ? error : new FieldError(String(error)));
      }
    };
    // A blob's bytes are not copied on their way to the worker.
    const own = typeof source === "string" ? new URL(source, document.baseURI).href : source instanceof Blob ? source : new Blob([source]);
    deviceLimits().then(
      (device) => this.ask({ kind: "load", source: own, device }),
      (error) => {
        this.terminate();
        this.fail(error);
      },
    );
  }

  /** What is in the file; null until it is opened. */
  get file(): Opened | null {
    return this.content?.opened ?? null;
  }

  /** The finest level that is shown; null before the first picture. */
  get finest(): number | null {
    return this.content?.atlas.finest ?? null;
  }

  /** Whether levels have come that `upload` will bring to the device. */
  get waiting(): boolean {
    return this.content?.atlas.waiting ?? false;
  }

  /** Whether a level's bytes are there and are being decoded. */
  get decoding(): boolean {
    return this.content?.atlas.decoding ?? false;
  }

  /** What the device holds; null before the first upload. */
  get textures(): Textures | null {
    return this.content?.atlas.textures ?? null;
  }

  /** Two corners, in local axes, between which something is to be seen; those of the box before the first level. */
  get visible(): [number[], number[]] {
    if (!this.content) return [[0, 0, 0], [0, 0, 0]];
    const { min, max } = this.content.opened.metadata.bounds;
    const at = (share: number[]) => share.map((share, axis) => min[axis] + share * (max[axis] - min[axis]));
    const [low, high] = this.content.atlas.occupied ?? [[0, 0, 0], [1, 1, 1]];
    return [at(low), at(high)];
  }

  /** Brings decoded blocks to the device, for a few milliseconds. Whether the picture has changed. */
  upload(gl: WebGL2RenderingContext): boolean {
    if (!this.content) return false;
    const { atlas } = this.content;
    const before = atlas.live.size;
    if (!atlas.upload(gl)) {
      this.round++;
      this.ask({ kind: "again" });
    }
    const isChanged = atlas.live.size !== before;
    if (atlas.waiting || isChanged) this.owner.tell("change", {});
    return isChanged;
  }

  /** Ends loading and frees the device's memory. */
  dispose(): void {
    this.terminate();
    this.reject(new FieldError("The field was given up before all of it was there.", REMEDY.again));
    this.content?.atlas.dispose();
    this.content = null;
  }

  /** Builds what does not depend on levels. */
  private begin(opened: Opened): void {
    const widest = Math.max(0, ...opened.network.flatMap((layer) => [layer.inputs, layer.outputs]));
    if (widest > WIDEST_LAYER) throw new FieldError(`The network has a layer of ${widest} values; this viewer takes ${WIDEST_LAYER}.`);
    this.owner.begin(opened);
    const atlas = new Atlas(opened, (error) => {
      this.terminate();
      atlas.dispose();
      this.content = null;
      this.fail(error);
    });
    this.content = { opened, atlas };
    if (opened.fileBytes >= HELPED_BYTES) this.startHelpers();
  }

  /** Starts as many decoders as the device has cores, beside the one that reads. */
  private startHelpers(): void {
    const ports = Array.from({ length: Math.min(MOST_HELPERS, navigator.hardwareConcurrency) }, (_, number) => {
      const { port1, port2 } = new MessageChannel();
      const helper = startDecoder();
      // The others do without one that does not start, or says why it cannot.
      helper.onerror = helper.onmessage = () => this.ask({ kind: "left", helper: number });
      this.helpers.push(helper);
      helper.postMessage({ kind: "help", port: port2 } satisfies Request, [port2]);
      return port1;
    });
    this.worker.postMessage({ kind: "crew", ports } satisfies Request, ports);
  }

  private terminate(): void {
    for (const worker of [this.worker, ...this.helpers]) worker.terminate();
  }

  private fail(error: FieldError): void {
    this.reject(error);
    this.owner.tell("failed", { error });
  }

  private ask(request: Request): void {
    this.worker.postMessage(request);
  }
}

/** A promise to be kept elsewhere; nobody has to listen to its failure. */
function promise<T>(): { promise: Promise<T>; resolve: (value: T) => void; reject: (error: FieldError) => void } {
  let resolve!: (value: T) => void;
  let reject!: (error: FieldError) => void;
  const made = new Promise<T>((yes, no) => ([resolve, reject] = [yes, no]));
  made.catch(() => {});
  return { promise: made, resolve, reject };
}
