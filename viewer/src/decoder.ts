/** Starts workers that decode containers. */

let startOwn: (() => Worker) | null = null;

/** Starts decoders by `start` from now on: for pages that hold the text of `worker.js` themselves. */
export function startDecodersBy(start: () => Worker): void {
  startOwn = start;
}

/** A worker of `worker.js`, which lies beside the script. */
export function startDecoder(): Worker {
  if (startOwn) return startOwn();
  try {
    // Bundlers look for exactly this.
    return new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  } catch {
    // A script of another host starts no worker, but a worker may import it.
    const address = new URL("worker.js", new URL(".", import.meta.url)).href;
    const text = new Blob([`import ${JSON.stringify(address)};`], { type: "text/javascript" });
    return new Worker(URL.createObjectURL(text), { type: "module" });
  }
}
