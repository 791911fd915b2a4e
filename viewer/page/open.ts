/** From a file, wherever its bytes are, to objects of a scene. */

import { type Opened, openAsset, openField } from "../src/stage/opened.js";

const GLB_MAGIC = 0x46546c67;

/** Opens a file that was dropped or chosen; told apart by content. */
export async function openFile(file: File): Promise<Opened> {
  const head = new DataView(await file.slice(0, 12).arrayBuffer());
  if (head.byteLength === 12 && head.getUint32(0, true) === GLB_MAGIC) {
    return openAsset(file.name, (loader) => file.arrayBuffer().then((bytes) => loader.parseAsync(bytes, "")));
  }
  return openField(file, file.name);
}
