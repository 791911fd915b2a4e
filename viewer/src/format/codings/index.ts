/**
 * How atlases are coded. A coding turns the bytes of an atlas chunk into codes, an unsigned integer
 * for each node; what codes mean is in `values.ts`. A new coding is a file here and a line of the table.
 */

import type { Encoding } from "../metadata.js";
import { decodeRuns } from "./runs.js";

export type Codes = Uint8Array | Uint16Array | Uint32Array;

/** What a coding must know of an atlas. */
export interface Atlas {
  encoding: Encoding;
  channels: number;
  /** Nodes along a block's edge. */
  edge: number;
  /** Stored blocks. */
  frames: number;
  /** Whose bytes they are, for messages. */
  name: string;
}

/** Codes of an atlas: frame by frame, channel by channel, nodes in C order. */
export type Coding = (atlas: Atlas, chunk: Uint8Array) => Codes;

/** Codings by the chunk type that uses them. */
export const CODINGS: Readonly<Record<string, Coding>> = {
  DENS: decodeRuns,
  DIFF: decodeRuns,
  FEAT: decodeRuns,
};
