/** Makes decoding fast if the page and the device allow WebAssembly; otherwise, the result is the same. */

import { prepareLanes } from "../format/codings/lanes.js";
import { prepareInflate } from "../format/zstd.js";
import { prepareSweeps } from "./sweeps.js";
import { prepareWeaver } from "./weaver.js";

export async function prepareDecoding(): Promise<void> {
  await Promise.all([prepareInflate(), prepareLanes(), prepareWeaver(), prepareSweeps()]);
}
