/** Workers that decode parts of levels for the one that reads the container. */

import { FieldError, REMEDY } from "../errors.js";
import type { Metadata } from "../format/metadata.js";
import { type Chunks, type DecodedPart, LevelDecoder } from "./level.js";
import type { Plan } from "./plan.js";

/** Fewer blocks than this are not worth another worker. */
const LEAST_BLOCKS = 512;

/** Consecutive blocks of a level or a shell without inherited ones. */
export interface Job {
  metadata: Metadata;
  plan: Plan;
  number: number;
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

/** Says that it has started, then does the jobs that come through a port. */
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

/** A worker that helps, as the one that reads knows it. */
class Helper {
  /** Whether it has started; false where it never will. */
  readonly started: Promise<boolean>;
  isBusy = false;
  /** Ends what is waited for. */
  private give: () => void = () => {};

  constructor(private readonly port: MessagePort) {
    this.started = new Promise((resolve) => {
      port.onmessage = () => resolve(true);
      this.give = () => resolve(false);
    });
  }

  /** Nothing will come any more. */
  leave(): void {
    this.give();
  }

  /** Does a job, whose chunks are given away; its marks of macro cells. */
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

  /** The helper of this number, in the order in which they were added, is gone. */
  leave(number: number): void {
    this.left.add(number);
    this.helpers[number]?.leave();
  }

  /** Helpers for a level of so many blocks, as soon as all have started that will; none where it is better decoded without. */
  async gather(blocks: number): Promise<Helper[]> {
    if (blocks < LEAST_BLOCKS) return [];
    const started = await Promise.all(this.helpers.map((helper) => helper.started));
    const present = this.helpers.filter((_, number) => started[number] && !this.left.has(number));
    return present.some(({ isBusy }) => isBusy) ? [] : present;
  }
}

/** Decodes all blocks of a level, each helper a share, which `job` makes; the marks of macro cells of all of them. */
export async function decodeShares(helpers: Helper[], blocks: number, job: (from: number, to: number) => Job, part: (part: DecodedPart) => void): Promise<Uint8Array | null> {
  const share = Math.ceil(blocks / helpers.length);
  const at = (number: number) => Math.min(blocks, number * share);
  const [first, ...others] = await Promise.all(helpers.map((helper, i) => helper.ask(job(at(i), at(i + 1)), part)));
  for (const marks of others) if (first && marks) for (let i = 0; i < marks.length; i++) first[i] |= marks[i];
  return first;
}
