/** Loads one container and hands its levels over. Errors come as words. */

import { FieldError, REMEDY } from "../errors.js";
import { type Listener, Loader } from "./loader.js";
import type { Reply, Request } from "./messages.js";

const port = self as unknown as {
  onmessage: (event: MessageEvent<Request>) => void;
  postMessage(reply: Reply, transfer?: Transferable[]): void;
};

let loader: Loader | null = null;

const listener: Listener = {
  opened: (opened) => port.postMessage({ kind: "opened", opened }),
  progress: (arrived) => port.postMessage({ kind: "progress", arrived }),
  level: (level) => {
    const arrays = [level.table, level.density, level.color, level.skipDistances];
    port.postMessage({ kind: "level", level }, arrays.flatMap((array) => (array ? [array.buffer] : [])));
  },
};

port.onmessage = async ({ data }) => {
  try {
    if (data.kind === "load") {
      loader = new Loader(data.source);
      await loader.load(data.device, listener);
      port.postMessage({ kind: "done" });
    } else {
      loader?.again(listener);
    }
  } catch (error) {
    const { message, remedy } = error instanceof FieldError ? error : new FieldError(unexpected(error), REMEDY.device);
    port.postMessage({ kind: "failed", message, remedy });
  }
};

/** What is no finding about the file: memory that the browser refuses, most of all. */
function unexpected(error: unknown): string {
  return `The file could not be loaded: ${error instanceof Error ? error.message : String(error)}.`;
}
