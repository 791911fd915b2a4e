/** Starts the device and queries its limits. */

import { Decoder } from "./decoder.js";
import { gpuLimits, limitsOf } from "./load/limits.js";
import type { DeviceLimits } from "./load/plan.js";

let known: Promise<DeviceLimits> | null = null;

/**
 * The limits of the device, queried once and in a worker. The first WebGL context of a browser starts its device, which
 * blocks the calling thread: with a software renderer, for half a second. Later contexts are immediate.
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

/** The answer of a worker; null if workers have no WebGL. */
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
