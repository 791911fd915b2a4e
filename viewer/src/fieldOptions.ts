/** What objects that show a field ask of its loading, and hear of it. */

import type { FieldError } from "./errors.js";
import type { Metadata } from "./format/metadata.js";
import type { Opened } from "./load/loader.js";

/** The events of loading. */
export interface FieldEvents {
  /** Header, metadata and network are loaded. */
  opened: { metadata: Metadata };
  /** More bytes have arrived. `total` is the number of bytes to load; 0 until known. */
  progress: { loaded: number; total: number };
  /** The picture has changed because a level, or a part of one, has arrived. Redraw. */
  change: {};
  /** All levels are loaded. */
  done: {};
  /** Loading failed. What was loaded before stays visible. */
  failed: { error: FieldError };
}

/** A framework's object that shows a field. */
export interface Owner {
  /** Builds what draws the field. */
  begin(opened: Opened): void;
  tell<Kind extends keyof FieldEvents>(kind: Kind, event: FieldEvents[Kind]): void;
}

/** Tracks what is being loaded, such as a `LoadingManager` of three.js. */
export interface Manager {
  itemStart(address: string): void;
  itemEnd(address: string): void;
  itemError(address: string): void;
  resolveURL?(address: string): string;
}

/** Options for loading a field. */
export interface FieldOptions {
  /** Cancels loading. What has loaded stays visible; promises are rejected with the signal's reason. */
  signal?: AbortSignal;
  /** Notified of the field, by its address, until its first level is loaded. */
  manager?: Manager;
  /** Sent with every request. */
  headers?: HeadersInit;
  credentials?: RequestCredentials;
  /**
   * Maximum bytes of textures of the field on each device. If its blocks do not all fit, those near the camera are
   * loaded, and coarser levels replace the others. Default: a quarter of the device memory, at most 1.5 GiB.
   */
  maxBytes?: number;
}

/** A field's use of device memory. */
export interface Budget {
  /** Bytes of all textures, and their limit. */
  bytes: number;
  most: number;
  /** Number of blocks on the device, and of loaded blocks. */
  blocks: [number, number];
}
