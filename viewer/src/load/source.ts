/** The sources of a container's bytes. */

import { FieldError, REMEDY } from "../errors.js";

/** A `.mipvog` file: its address, its bytes, or a response of a server, which is read completely. */
export type Source = string | URL | Blob | ArrayBuffer | ArrayBufferView<ArrayBuffer> | Response;

/** A source in the form sent to the worker. */
export type OwnSource = string | Blob;

/** The headers and credentials of requests, in addition to the range. */
export interface RequestOptions {
  headers?: Record<string, string>;
  credentials?: RequestCredentials;
}

/** How bytes arrive. */
export type Transfer = "ranges" | "whole" | "memory";

/** Called with the number of bytes received. */
export type Progress = (arrived: number) => void;

/** Bytes that are read in order, each piece once. */
export interface ByteSource {
  /** Known after the first read. */
  readonly transfer: Transfer;
  /** Total number of bytes, if known after the first read. */
  readonly length: number | null;
  /** Reads the bytes `[from, to)`, or as many as exist. `from` is the end of the last read. */
  read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>>;
  /** Cancels pending requests. */
  cancel(): void;
}

export function openSource(source: OwnSource, request: RequestOptions): ByteSource {
  return typeof source === "string" ? new HttpSource(source, request) : new MemorySource(source);
}

class MemorySource implements ByteSource {
  readonly transfer = "memory";
  readonly length: number;
  private isCancelled = false;

  constructor(private readonly blob: Blob) {
    this.length = blob.size;
  }

  async read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    const bytes = new Uint8Array(await this.blob.slice(from, to).arrayBuffer());
    if (this.isCancelled) throw new FieldError("Loading was given up.", REMEDY.again);
    progress(from + bytes.length);
    return bytes;
  }

  cancel(): void {
    this.isCancelled = true;
  }
}

/** Delays before retries of a failed request, in milliseconds. */
const WAITS = [500, 1500, 4000];
/** A request that receives nothing for this long has failed. */
const IDLE_MS = 30_000;
/** Status codes of errors that may be temporary. */
const PASSING = [408, 429, 500, 502, 503, 504];

/** HTTP: ranges if the server supports them, else one streamed download. */
class HttpSource implements ByteSource {
  transfer: Transfer = "ranges";
  length: number | null = null;
  private readonly abort = new AbortController();
  private stream: Stream | null = null;

  constructor(
    private readonly url: string,
    private readonly request: RequestOptions,
  ) {}

  async read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    const pieces: Uint8Array[] = [];
    let at = from;
    // A server may answer with less than was asked for.
    while (!this.stream && at < this.end(to)) {
      const piece = await this.persist(() => this.readPart(at, this.end(to), progress));
      if (!piece || piece.length === 0) break;
      pieces.push(piece);
      at += piece.length;
    }
    if (this.stream && at < to) {
      const piece = await this.stream.read(to - at, progress);
      pieces.push(piece);
      if (at + piece.length === this.length) await this.stream.end();
    }
    return joined(pieces);
  }

  /** The end of a piece that should end at `to`. */
  private end(to: number): number {
    return this.length === null ? to : Math.min(to, this.length);
  }

  /** Retries work that may succeed later. */
  private async persist<T>(work: () => Promise<T>): Promise<T> {
    for (const wait of WAITS) {
      try {
        return await work();
      } catch (error) {
        if (!(error instanceof Unreachable) || this.abort.signal.aborted) throw error;
        // What nothing has come of may never come: one more try tells.
        if (this.length === null && wait !== WAITS[0]) throw error;
        await new Promise((done) => setTimeout(done, wait));
      }
    }
    return work();
  }

  /** Bytes from `from` on, up to `to`. Null if there are none, or if everything arrives as one stream from now on. */
  private async readPart(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer> | null> {
    try {
      const response = await this.fetch(from, to);
      if (!response) return null;
      if (response.status !== 206) return this.begin(response, from);
      const range = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(response.headers.get("Content-Range") ?? "");
      // Across origins the header is hidden unless the server shows it; checksums then tell.
      if (range && Number(range[1]) !== from) throw new FieldError(`The server sent bytes from ${range[1]} instead of ${from}.`, REMEDY.network);
      const length = range && range[3] !== "*" ? Number(range[3]) : this.length;
      if (this.length !== null && length !== this.length) throw new FieldError("The file on the server has changed since it was opened.", REMEDY.again);
      this.length = length;
      const count = range ? Number(range[2]) + 1 - from : to - from;
      const stream = new Stream(response, from);
      const bytes = await stream.read(Math.min(count, to - from), progress);
      // What has ended by itself is not broken off afterwards.
      if (bytes.length === count) await stream.end();
      return bytes;
    } catch (error) {
      // What is stored compressed can be read whole, but no part of it.
      if (!(error instanceof Unreachable) || from > 0 || this.abort.signal.aborted) throw error;
      const response = await this.fetch(0, null).catch(() => null);
      if (!response) throw error;
      return this.begin(response, 0);
    }
  }

  /** Reads everything as one stream from now on. */
  private begin(response: Response, from: number): null {
    if (from > 0) throw new FieldError("The server stopped offering parts of the file.", REMEDY.network);
    this.transfer = "whole";
    const length = Number(response.headers.get("Content-Length") ?? NaN);
    // A compressed transfer states another length than the file's.
    this.length = Number.isFinite(length) && !response.headers.get("Content-Encoding") ? length : null;
    this.stream = new Stream(response, 0);
    return null;
  }

  cancel(): void {
    this.abort.abort();
  }

  /** Requests the bytes `[from, to)`, or everything if `to` is null. Null if the file ends before these bytes. */
  private async fetch(from: number, to: number | null): Promise<Response | null> {
    const { headers, ...request } = this.request;
    const range = to === null ? {} : { Range: `bytes=${from}-${to - 1}` };
    let response: Response;
    const idle = new AbortController();
    const timer = setTimeout(() => idle.abort(), IDLE_MS);
    if (this.abort.signal.aborted) idle.abort();
    this.abort.signal.addEventListener("abort", () => idle.abort(), { once: true });
    try {
      response = await fetch(this.url, { ...request, headers: { ...headers, ...range }, signal: idle.signal });
    } catch {
      const isForeign = new URL(this.url).origin !== self.origin && /^https?:/.test(this.url);
      throw new Unreachable(`${this.url} cannot be reached.`, isForeign ? REMEDY.foreignHost : REMEDY.network);
    } finally {
      clearTimeout(timer);
    }
    // A file shorter than the first piece is an unsatisfiable range only if it is empty.
    if (response.status === 416 && from === 0) throw new FieldError("The file is empty.", REMEDY.foreign);
    // A server that hides where parts end can only be asked for more.
    if (response.status === 416 && this.length === null) return null;
    if (response.status === 416) throw new FieldError(`The file ends before byte ${from}: it has changed since it was opened.`, REMEDY.network);
    if (!response.ok) throw new (PASSING.includes(response.status) ? Unreachable : FieldError)(`${this.url} answers ${response.status} ${response.statusText}.`, REMEDY.network);
    return response;
  }
}

/** No response, or a response that ended early. */
class Unreachable extends FieldError {}

/** A response's body, in pieces of a requested size. */
class Stream {
  private readonly reader: ReadableStreamDefaultReader<Uint8Array> | undefined;
  /** Received bytes after the last piece. */
  private rest: Uint8Array = new Uint8Array(0);

  constructor(
    response: Response,
    private arrived: number,
    /** Whether the rest can be requested. */
    private readonly isPart = response.status === 206,
  ) {
    this.reader = response.body?.getReader();
  }

  /** The next `count` bytes, or as many as exist. */
  async read(count: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    const pieces: Uint8Array[] = [];
    let left = count;
    while (left > 0) {
      if (this.rest.length === 0) {
        const next = await this.next().catch((error: unknown) => {
          // What came before the connection broke need not come again.
          if (pieces.length === 0 || !this.isPart) throw error;
        });
        if (!next) break;
        this.rest = next;
      }
      const piece = this.rest.subarray(0, left);
      this.rest = this.rest.subarray(piece.length);
      left -= piece.length;
      this.arrived += piece.length;
      pieces.push(piece);
      progress(this.arrived);
    }
    return joined(pieces);
  }

  /** Waits until the response ends. */
  async end(): Promise<void> {
    const { value } = (await this.reader?.read().catch(() => null)) ?? {};
    if (value) void this.reader?.cancel().catch(() => {});
  }

  private async next(): Promise<Uint8Array | undefined> {
    let timer: ReturnType<typeof setTimeout> | undefined;
    const idle = new Promise<never>((_, fail) => (timer = setTimeout(fail, IDLE_MS)));
    try {
      return (await Promise.race([this.reader?.read(), idle]))?.value;
    } catch {
      void this.reader?.cancel().catch(() => {});
      throw new Unreachable("The connection broke while the file was on its way.", REMEDY.network);
    } finally {
      clearTimeout(timer);
    }
  }
}

function joined(pieces: Uint8Array[]): Uint8Array<ArrayBuffer> {
  const out = new Uint8Array(pieces.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const piece of pieces) {
    out.set(piece, at);
    at += piece.length;
  }
  return out;
}
