/** The codes of an atlas, and the data that a coding needs to decode them. */

import type { Encoding } from "../metadata.js";

export type Codes = Uint8Array | Uint16Array | Uint32Array;

/** The properties of an atlas that a coding needs. */
export interface Atlas {
  encoding: Encoding;
  channels: number;
  /** Nodes along each edge of a block. */
  edge: number;
  /** Number of stored blocks. */
  frames: number;
  /** Name of the atlas, for messages. */
  name: string;
}

export interface Coding {
  /**
   * Decodes at least the frames `[from, to)` of an atlas, starting at frame `first`: frame by frame, channel by
   * channel, nodes in C order.
   */
  decode(atlas: Atlas, chunk: Uint8Array, from: number, to: number): { first: number; codes: Codes };
  /** A copy of the chunk whose large parts contain only the data for the frames `[from, to)`. */
  share(atlas: Atlas, chunk: Uint8Array, from: number, to: number): Uint8Array;
}
