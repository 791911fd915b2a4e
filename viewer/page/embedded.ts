/** A page that holds its file and its worker itself, as `export --to html` writes it. */

import { startDecodersBy } from "../src/index.js";

/** The file that the page opens: its name, and its bytes or its address. */
export type OwnFile = { name: string; bytes: Blob } | { name: string; address: string };

/** The file of a page that was made for one; null on a page for any file. */
export function ownFile(): OwnFile | null {
  const { file } = document.body.dataset;
  if (!file) return null;
  const data = document.getElementById("data");
  return data ? { name: file, bytes: new Blob([decoded(data.textContent ?? "")]) } : { name: file, address: encodeURIComponent(file) };
}

/** Starts decoders from the page itself, where it holds their script. */
export function useOwnWorker(): void {
  const script = document.getElementById("worker");
  if (!script) return;
  const address = URL.createObjectURL(new Blob([script.textContent ?? ""], { type: "text/javascript" }));
  startDecodersBy(() => new Worker(address));
}

/** The bytes of a text in base64. */
function decoded(text: string): Uint8Array<ArrayBuffer> {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}
