/** Where a container's bytes come from. */

import { FieldError, REMEDY } from "../errors.js";

/** A `.mipvog` file: its address, or its bytes. */
export type Source = string | Blob | ArrayBuffer;

/** The same on its way to the worker. */
export type OwnSource = string | Blob;

/** How bytes arrive. */
export type Transfer = "ranges" | "whole" | "memory";

/** Called with all bytes that have arrived. */
export type Progress = (arrived: number) => void;

/** Bytes that are read in order, each piece once. */
export interface ByteSource {
  /** Known after the first read. */
  readonly transfer: Transfer;
  /** Bytes of the whole, if known after the first read. */
  readonly length: number | null;
  /** Bytes `[from, to)`, or as many of them as there are. `from` is where the last read ended. */
  read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>>;
  /** Ends what is under way. */
  cancel(): void;
}

export function openSource(source: OwnSource): ByteSource {
  return typeof source === "string" ? new HttpSource(source) : new MemorySource(source);
}

class MemorySource implements ByteSource {
  readonly transfer = "memory";
  readonly length: number;

  constructor(private readonly blob: Blob) {
    this.length = blob.size;
  }

  async read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    const bytes = new Uint8Array(await this.blob.slice(from, to).arrayBuffer());
    progress(from + bytes.length);
    return bytes;
  }

  cancel(): void {}
}

/** HTTP: ranges where the server offers them, else one download that is read as it comes. */
class HttpSource implements ByteSource {
  transfer: Transfer = "ranges";
  length: number | null = null;
  private readonly abort = new AbortController();
  private stream: Stream | null = null;

  constructor(private readonly url: string) {}

  async read(from: number, to: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    if (this.stream) return this.stream.read(to - from, progress);
    const last = this.length === null ? to : Math.min(to, this.length);
    if (from >= last) return new Uint8Array(0);
    const response = await this.fetch(from, { Range: `bytes=${from}-${last - 1}` });
    if (response.status === 206) {
      const range = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(response.headers.get("Content-Range") ?? "");
      // Across origins the header is hidden unless the server shows it; checksums then tell.
      if (range && Number(range[1]) !== from) throw new FieldError(`The server sent bytes from ${range[1]} instead of ${from}.`, REMEDY.network);
      if (range && range[3] !== "*") this.length = Number(range[3]);
      return new Stream(response, from).read(last - from, progress);
    }
    if (from > 0) throw new FieldError("The server stopped offering parts of the file.", REMEDY.network);
    this.transfer = "whole";
    const length = Number(response.headers.get("Content-Length") ?? NaN);
    // A compressed transfer states another length than the file's.
    this.length = Number.isFinite(length) && !response.headers.get("Content-Encoding") ? length : null;
    this.stream = new Stream(response, 0);
    return this.stream.read(to, progress);
  }

  cancel(): void {
    this.abort.abort();
  }

  private async fetch(from: number, headers: Record<string, string>): Promise<Response> {
    let response: Response;
    try {
      response = await fetch(this.url, { headers, signal: this.abort.signal });
    } catch {
      throw new FieldError(`${this.url} cannot be reached.`, REMEDY.network);
    }
    // A file shorter than the first piece is an unsatisfiable range only if it is empty.
    if (response.status === 416 && from === 0) throw new FieldError("The file is empty.", REMEDY.foreign);
    if (response.status === 416) throw new FieldError(`The file ends before byte ${from}: it has changed since it was opened.`, REMEDY.network);
    if (!response.ok) throw new FieldError(`${this.url} answers ${response.status} ${response.statusText}.`, REMEDY.network);
    return response;
  }
}

/** A response's body, in pieces of a wanted size. */
class Stream {
  private readonly reader: ReadableStreamDefaultReader<Uint8Array> | undefined;
  /** What has come beyond the last piece. */
  private rest: Uint8Array = new Uint8Array(0);

  constructor(
    response: Response,
    private arrived: number,
  ) {
    this.reader = response.body?.getReader();
  }

  /** The next `count` bytes, or as many as there are. */
  async read(count: number, progress: Progress): Promise<Uint8Array<ArrayBuffer>> {
    const pieces: Uint8Array[] = [];
    let left = count;
    while (left > 0) {
      if (this.rest.length === 0) {
        const next = await this.next();
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
    const out = new Uint8Array(count - left);
    let at = 0;
    for (const piece of pieces) {
      out.set(piece, at);
      at += piece.length;
    }
    return out;
  }

  private async next(): Promise<Uint8Array | undefined> {
    try {
      return (await this.reader?.read())?.value;
    } catch {
      throw new FieldError("The connection broke while the file was on its way.", REMEDY.network);
    }
  }
}
