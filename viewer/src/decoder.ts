/** Starts the workers that decode containers. */

import { FieldError, REMEDY } from "./errors.js";
import type { Reply, Request } from "./load/messages.js";

/**
 * Whether the worker is a file beside the script. Whether the build contains its text: true for the package, whose
 * users may serve it in ways that lose `worker.js`.
 */
declare const HAS_WORKER_FILE: boolean;
declare const HAS_WORKER_TEXT: boolean;

/** Creates a worker. If it throws, or the worker's script does not load, the next way is tried. */
type Way = () => Worker | Promise<Worker>;

const readText = HAS_WORKER_TEXT ? () => import("./load/text.js") : null;

let ways: Way[] = [...(HAS_WORKER_FILE ? [beside] : []), ...(readText ? [() => fromText(readText)] : [])];
/**
 * The address of the worker's text. It is made once and never revoked: there is no sign of when the last worker has
 * read it.
 */
let textAddress: Promise<string> | null = null;
/** Trusted types, which TypeScript does not know. A trusted address is accepted wherever a string is. */
interface Policy {
  createScriptURL(address: string): string;
}
let policy: Policy | null = null;
let isTyped = false;

/** Makes `start` start all decoders from now on, for pages that hold the text of `worker.js` themselves. */
export function startDecodersBy(start: () => Worker): void {
  ways = [start];
}

/** A worker running `worker.js`. Messages wait until its script runs. */
export class Decoder {
  onmessage: (reply: Reply) => void = () => {};
  /** Called if the worker cannot be started, or crashes. */
  onerror: (error: FieldError) => void = () => {};
  private worker: Worker | null = null;
  /** Messages sent before the script runs; null from then on. */
  private waiting: [Request, Transferable[]][] | null = [];
  private isOver = false;

  constructor() {
    void this.start([...ways]);
  }

  post(request: Request, transfer: Transferable[] = []): void {
    if (this.waiting) this.waiting.push([request, transfer]);
    else this.worker!.postMessage(request, transfer);
  }

  terminate(): void {
    this.isOver = true;
    this.worker?.terminate();
  }

  private async start([way, ...others]: Way[]): Promise<void> {
    let failure: unknown = null;
    try {
      this.worker = await way();
    } catch (error) {
      failure = error;
    }
    if (this.isOver) return this.worker?.terminate();
    const next = (failure: unknown) => {
      if (this.isOver) return;
      if (this.waiting && others.length > 0) return void this.start(others);
      this.onerror(failure instanceof FieldError ? failure : new FieldError("The decoder could not be started.", REMEDY.decoder));
    };
    if (!this.worker || failure) return next(failure);
    this.worker.onerror = () => next(null);
    this.worker.onmessage = ({ data }: MessageEvent<Reply>) => {
      if (data.kind !== "running") return this.onmessage(data);
      // Those that are started later need not try what did not work.
      if (ways.includes(way)) ways = [way, ...ways.filter((other) => other !== way)];
      for (const [request, transfer] of this.waiting ?? []) this.worker!.postMessage(request, transfer);
      this.waiting = null;
    };
  }
}

/** Starts the worker from the script beside this one. */
function beside(): Worker {
  try {
    // Bundlers look for exactly this.
    if (!isTyped) return new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  } catch (error) {
    // The page requires trusted types, which nothing else tells.
    isTyped = "trustedTypes" in globalThis && error instanceof TypeError;
    if (!isTyped) throw error;
  }
  return new Worker(trusted(new URL("worker.js", new URL(".", import.meta.url)).href), { type: "module" });
}

/**
 * Starts the worker from its text: workers cannot load scripts of other hosts, and development servers lose
 * `worker.js`.
 */
async function fromText(read: NonNullable<typeof readText>): Promise<Worker> {
  textAddress ??= read().then(({ default: text }) => URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  return new Worker(trusted(await textAddress), { type: "module" });
}

/** An address as pages with trusted types require it. */
function trusted(address: string): string {
  const { trustedTypes } = globalThis as { trustedTypes?: { createPolicy(name: string, rules: Policy): Policy } };
  if (!trustedTypes) return address;
  try {
    policy ??= trustedTypes.createPolicy("mipvog-viewer", { createScriptURL: (address) => address });
  } catch {
    throw new FieldError("The page's content security policy knows no trusted types of mipvog-viewer, which the decoder's address has.", REMEDY.policy);
  }
  return policy.createScriptURL(address);
}
