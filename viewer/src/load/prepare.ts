/** Makes decoding fast where the page and the device allow it; without this, it is as right. */

import { prepareLanes } from "../format/codings/lanes.js";
import { prepareInflate } from "../format/zstd.js";
import { prepareSweeps } from "./sweeps.js";
import { prepareWeaver } from "./weaver.js";

export async function prepareDecoding(): Promise<void> {
  await Promise.all([prepareInflate(), prepareLanes(), prepareWeaver(), prepareSweeps()]);
}
