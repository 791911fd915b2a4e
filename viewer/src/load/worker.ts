/** Loads one container and passes its levels on. Errors are sent as text. */

import { FieldError, REMEDY } from "../errors.js";
import { buffersOf, help } from "./crew.js";
import { limitsOf } from "./limits.js";
import { type Listener, Loader } from "./loader.js";
import type { Reply, Request } from "./messages.js";
import type { DeviceLimits } from "./plan.js";
import { prepareDecoding } from "./prepare.js";

const port = self as unknown as {
  onmessage: (event: MessageEvent<Request>) => void;
  postMessage(reply: Reply, transfer?: Transferable[]): void;
};

let loader: Loader | null = null;
const prepared = prepareDecoding();

const listener: Listener = {
  opened: (opened) => port.postMessage({ kind: "opened", opened }),
  progress: (arrived) => port.postMessage({ kind: "progress", arrived }),
  begun: (part, round) => port.postMessage({ kind: "begun", part, round }),
  part: (part, round) => port.postMessage({ kind: "part", part, round }, buffersOf(part)),
  entry: (entry, round) => port.postMessage({ kind: "entry", entry, round }),
  residents: (held, known, isAnswer) => port.postMessage({ kind: "residents", held, known, isAnswer }),
};

port.onmessage = async ({ data }) => {
  if (data.kind === "device") return port.postMessage({ kind: "device", limits: deviceLimits() });
  try {
    await prepared;
    if (data.kind === "load") {
      loader = new Loader(data.source, data.request, listener);
      await loader.load(data.device);
      port.postMessage({ kind: "done" });
    } else if (data.kind === "crew") {
      data.ports.forEach((port) => loader?.crew.add(port));
    } else if (data.kind === "left") {
      loader?.crew.leave(data.helper);
    } else if (data.kind === "stop") {
      loader?.stop();
    } else if (data.kind === "look") {
      await loader?.look(data.camera);
    } else if (data.kind === "help") {
      help(data.port);
    } else {
      await loader?.again();
      port.postMessage({ kind: "again" });
    }
  } catch (error) {
    const { message, remedy } = error instanceof FieldError ? error : new FieldError(unexpected(error), REMEDY.device);
    port.postMessage({ kind: "failed", message, remedy });
  }
};

port.postMessage({ kind: "running" });

/** The limits of the device; null if workers have no WebGL. */
function deviceLimits(): DeviceLimits | null {
  try {
    return limitsOf(new OffscreenCanvas(1, 1));
  } catch {
    return null;
  }
}

/** The message of an error that is not a finding about the file, such as lack of memory. */
function unexpected(error: unknown): string {
  return `The file could not be loaded: ${error instanceof Error ? error.message : String(error)}.`;
}
