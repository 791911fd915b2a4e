/** Workers that help the main worker decode parts of levels. */

import { FieldError, REMEDY } from "../errors.js";
import type { Metadata } from "../format/metadata.js";
import { type Chunks, type DecodedPart, LevelDecoder } from "./level.js";
import type { Plan } from "./plan.js";

/** Minimum number of blocks per helper. */
const LEAST_BLOCKS = 512;

/** Consecutive blocks of a level or a shell without inherited blocks. */
export interface Job {
  metadata: Metadata;
  plan: Plan;
  number: number;
  chunks: Chunks;
  from: number;
  to: number;
}

/** A helper's answers to a job: its parts, then the marks of macro cells; or an error. */
type Answer = { part: DecodedPart } | { marks: Uint8Array | null } | { message: string; remedy: string };

/** The buffers of a part, for transfer without a copy. */
export function buffersOf(part: DecodedPart): Transferable[] {
  return [part.color, part.density, part.directional].flatMap((bricks) => (bricks ? [bricks.buffer as ArrayBuffer] : []));
}

/** Reports that the helper has started, then runs the jobs that arrive at a port. */
export function help(port: MessagePort): void {
  const answer = (what: Answer, transfer: Transferable[] = []) => port.postMessage(what, transfer);
  port.onmessage = ({ data: { metadata, plan, number, chunks, from, to } }: MessageEvent<Job>) => {
    try {
      const decoder = new LevelDecoder(metadata, plan, number, chunks, null);
      for (const part of decoder.parts(from, to)) answer({ part }, buffersOf(part));
      answer({ marks: decoder.marks });
    } catch (error) {
      const { message, remedy } = error instanceof FieldError ? error : new FieldError(String(error), REMEDY.device);
      answer({ message, remedy });
    }
  };
  port.postMessage(null);
}

/** A helper, as seen by the main worker. */
class Helper {
  /** Resolves to true when the helper has started, or to false if it never will. */
  readonly started: Promise<boolean>;
  isBusy = false;
  /** Ends the pending job. */
  private give: () => void = () => {};

  constructor(private readonly port: MessagePort) {
    this.started = new Promise((resolve) => {
      port.onmessage = () => resolve(true);
      this.give = () => resolve(false);
    });
  }

  /** Removes the helper: no more answers will come. */
  leave(): void {
    this.give();
  }

  /** Runs a job, whose chunks are transferred. Returns its marks of macro cells. */
  ask(job: Job, part: (part: DecodedPart) => void): Promise<Uint8Array | null> {
    const { port } = this;
    this.isBusy = true;
    return new Promise((resolve, reject) => {
      this.give = () => reject(new FieldError("A decoder has ended before its work was done.", REMEDY.device));
      port.onmessage = ({ data }: MessageEvent<Answer>) => {
        if ("part" in data) return part(data.part);
        this.isBusy = false;
        if ("marks" in data) resolve(data.marks);
        else reject(new FieldError(data.message, data.remedy));
      };
      port.postMessage(job, Object.values(job.chunks).map(({ bytes }) => bytes.buffer as ArrayBuffer));
    });
  }
}

export class Crew {
  private readonly helpers: Helper[] = [];
  private readonly left = new Set<number>();

  add(port: MessagePort): void {
    this.helpers.push(new Helper(port));
  }

  /** Removes a helper, by its index in the order of addition. */
  leave(number: number): void {
    this.left.add(number);
    this.helpers[number]?.leave();
  }

  /**
   * Helpers for a level of this many blocks, as soon as all helpers have started or failed to. Empty if decoding is
   * faster without helpers.
   */
  async gather(blocks: number): Promise<Helper[]> {
    if (blocks < LEAST_BLOCKS) return [];
    const started = await Promise.all(this.helpers.map((helper) => helper.started));
    const present = this.helpers.filter((_, number) => started[number] && !this.left.has(number));
    return present.some(({ isBusy }) => isBusy) ? [] : present;
  }
}

/**
 * Decodes all blocks of a level. Each helper gets a share, which `job` creates. Returns the combined marks of macro
 * cells.
 */
export async function decodeShares(helpers: Helper[], blocks: number, job: (from: number, to: number) => Job, part: (part: DecodedPart) => void): Promise<Uint8Array | null> {
  const share = Math.ceil(blocks / helpers.length);
  const at = (number: number) => Math.min(blocks, number * share);
  const [first, ...others] = await Promise.all(helpers.map((helper, i) => helper.ask(job(at(i), at(i + 1)), part)));
  for (const marks of others) if (first && marks) for (let i = 0; i < marks.length; i++) first[i] |= marks[i];
  return first;
}
