/** The codes of an atlas, and what a coding must know to find them. */

import type { Encoding } from "../metadata.js";

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

export interface Coding {
  /**
   * Codes of at least the frames `[from, to)` of an atlas, from frame `first` on: frame by frame, channel by channel, nodes
   * in C order.
   */
  decode(atlas: Atlas, chunk: Uint8Array, from: number, to: number): { first: number; codes: Codes };
  /** A copy of the chunk that holds, of what is large, only what the frames `[from, to)` are decoded from. */
  share(atlas: Atlas, chunk: Uint8Array, from: number, to: number): Uint8Array;
}
