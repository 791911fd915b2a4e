/** Starts the device, and tells what it can hold. */

import { Decoder } from "./decoder.js";
import { gpuLimits, limitsOf } from "./load/limits.js";
import type { DeviceLimits } from "./load/plan.js";

let known: Promise<DeviceLimits> | null = null;

/**
 * Asked once, and in a worker: the first context of a browser starts its device, which holds up the thread that asks for
 * it, by half a second on a software renderer. Contexts that are made after that are there at once.
 */
export function deviceLimits(): Promise<DeviceLimits> {
  return (known ??= ask());
}

async function ask(): Promise<DeviceLimits> {
  const limits = await askWorker();
  if (limits) return limits;
  try {
    return limitsOf(document.createElement("canvas"));
  } catch (error) {
    const other = await gpuLimits();
    if (other) return other;
    throw error;
  }
}

/** What a worker answers; null where workers have no WebGL. */
function askWorker(): Promise<DeviceLimits | null> {
  return new Promise((resolve) => {
    const worker = new Decoder();
    const end = (limits: DeviceLimits | null) => {
      worker.terminate();
      resolve(limits);
    };
    // A decoder that does not start is told of by who needs it to decode.
    worker.onerror = () => end(null);
    worker.onmessage = (reply) => end(reply.kind === "device" ? reply.limits : null);
    worker.post({ kind: "device" });
  });
}
