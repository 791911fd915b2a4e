/** Makes decoding fast where the page and the device allow it; without this, it is as right. */

import { prepareLanes } from "../format/codings/lanes.js";
import { prepareInflate } from "../format/zstd.js";
import { prepareBricks } from "./fill.js";
import { prepareSweeps } from "./sweeps.js";

export async function prepareDecoding(): Promise<void> {
  await Promise.all([prepareInflate(), prepareLanes(), prepareBricks(), prepareSweeps()]);
}
