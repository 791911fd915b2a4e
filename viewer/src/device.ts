/** Starts the device, and tells what it can hold. */

import { startDecoder } from "./decoder.js";
import { limitsOf } from "./load/limits.js";
import type { Reply, Request } from "./load/messages.js";
import type { DeviceLimits } from "./load/plan.js";

let known: Promise<DeviceLimits> | null = null;

/**
 * Asked once, and in a worker: the first context of a browser starts its device, which holds up the thread that asks for
 * it, by half a second on a software renderer. Contexts that are made after that are there at once.
 */
export function deviceLimits(): Promise<DeviceLimits> {
  return (known ??= askWorker().then((limits) => limits ?? limitsOf(document.createElement("canvas"))));
}

/** What a worker answers; null where workers have no WebGL. */
function askWorker(): Promise<DeviceLimits | null> {
  return new Promise((resolve) => {
    const worker = startDecoder();
    const end = (limits: DeviceLimits | null) => {
      worker.terminate();
      resolve(limits);
    };
    // A decoder that does not start is told of by who needs it to decode.
    worker.onerror = () => end(null);
    worker.onmessage = ({ data }: MessageEvent<Reply>) => end(data.kind === "device" ? data.limits : null);
    worker.postMessage({ kind: "device" } satisfies Request);
  });
}
