/** Workers that decode parts of levels for the one that reads the container. */

import { FieldError, REMEDY } from "../errors.js";
import type { Metadata } from "../format/metadata.js";
import { type Chunks, type DecodedPart, LevelDecoder } from "./level.js";
import type { Plan } from "./plan.js";

/** Fewer blocks than this are not worth another worker. */
const LEAST_BLOCKS = 512;

/** Consecutive blocks of a level without inherited ones. */
export interface Job {
  metadata: Metadata;
  plan: Plan;
  level: number;
  chunks: Chunks;
  from: number;
  to: number;
}

/** What a helper answers to a job: its parts, then the marks of macro cells; or what is wrong. */
type Answer = { part: DecodedPart } | { marks: Uint8Array | null } | { message: string; remedy: string };

/** The buffers of a part, which go without a copy. */
export function buffersOf(part: DecodedPart): Transferable[] {
  return [part.color, part.density, part.directional].flatMap((bricks) => (bricks ? [bricks.buffer as ArrayBuffer] : []));
}

/** Does the jobs that come through a port. */
export function help(port: MessagePort): void {
  const answer = (what: Answer, transfer: Transferable[] = []) => port.postMessage(what, transfer);
  port.onmessage = ({ data: { metadata, plan, level, chunks, from, to } }: MessageEvent<Job>) => {
    try {
      const decoder = new LevelDecoder(metadata, plan, level, chunks, null);
      for (const part of decoder.parts(from, to)) answer({ part }, buffersOf(part));
      answer({ marks: decoder.marks });
    } catch (error) {
      const { message, remedy } = error instanceof FieldError ? error : new FieldError(String(error), REMEDY.device);
      answer({ message, remedy });
    }
  };
}

export class Crew {
  private readonly idle: MessagePort[] = [];
  private size = 0;

  add(port: MessagePort): void {
    this.idle.push(port);
    this.size++;
  }

  /** Whether a level of so many blocks should be decoded by helpers. */
  takes(blocks: number): boolean {
    return this.idle.length === this.size && this.size > 0 && blocks >= LEAST_BLOCKS;
  }

  /** Decodes all blocks of a level, each helper a share; the marks of macro cells of all of them. */
  async decode(job: Omit<Job, "from" | "to">, blocks: number, part: (part: DecodedPart) => void): Promise<Uint8Array | null> {
    const ports = this.idle.splice(0);
    const share = Math.ceil(blocks / ports.length);
    const ends = ports.map((port, i) => this.ask(port, { ...job, from: Math.min(blocks, i * share), to: Math.min(blocks, (i + 1) * share) }, part));
    const all = await Promise.all(ends);
    const [first, ...others] = all;
    for (const marks of others) if (first && marks) for (let i = 0; i < marks.length; i++) first[i] |= marks[i];
    return first;
  }

  private ask(port: MessagePort, job: Job, part: (part: DecodedPart) => void): Promise<Uint8Array | null> {
    return new Promise((resolve, reject) => {
      port.onmessage = ({ data }: MessageEvent<Answer>) => {
        if ("part" in data) return part(data.part);
        this.idle.push(port);
        if ("marks" in data) resolve(data.marks);
        else reject(new FieldError(data.message, data.remedy));
      };
      port.postMessage(job);
    });
  }
}
