/** Starts workers that decode containers. */

let startOwn: (() => Worker) | null = null;
/** The address of a script that imports `worker.js`; made once, because nobody can tell when the last worker has read it. */
let importer: string | null = null;

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
    importer ??= importerOf(new URL("worker.js", new URL(".", import.meta.url)).href);
    return new Worker(importer, { type: "module" });
  }
}

function importerOf(address: string): string {
  return URL.createObjectURL(new Blob([`import ${JSON.stringify(address)};`], { type: "text/javascript" }));
}
