/** What a field asks of a device for its textures. WebGL 2 and WebGPU answer in files of their own. */

import type { Triple } from "../format/metadata.js";

/** Formats of texels, by their names in WebGPU. */
export type Format = "r8unorm" | "r16float" | "r32float" | "rgba8unorm" | "rgba16float" | "rgba32float" | "r32uint" | "rgba8uint";

export const FORMAT_BYTES: Readonly<Record<Format, number>> = { r8unorm: 1, r16float: 2, r32float: 4, rgba8unorm: 4, rgba16float: 8, rgba32float: 16, r32uint: 4, rgba8uint: 4 };

export interface TextureShape {
  format: Format;
  size: Triple;
  /** Whether it has two axes. */
  flat?: boolean;
}

/** A texture as its device made it. `handle` is what frameworks draw from. */
export interface DeviceTexture extends TextureShape {
  readonly handle: WebGLTexture | GPUTexture;
  /** Called when it is freed, for who wrapped it. */
  freed?: () => void;
}

/** The textures of one device: a context of WebGL 2, or a device of WebGPU. */
export interface TextureDevice {
  /** Whether the device is gone, with all that it held. */
  readonly isLost: boolean;
  /** Runs allocations and writes, and leaves the device as frameworks know it. */
  keeping<T>(run: () => T): T;
  /** Runs the allocations of a field, and calls `full`, later, where the device has no room for them. */
  allocating<T>(run: () => T, full: () => void): T;
  /** Makes a texture of zeros. Only within `keeping` or `allocating`, as are the next two. */
  make(shape: TextureShape): DeviceTexture;
  /** Writes a box of texels, `values` being tight rows. */
  write(texture: DeviceTexture, at: Triple, size: Triple, values: ArrayBufferView): void;
  free(texture: DeviceTexture): void;
  /** Calls back when the device is lost; what is returned ends this. */
  onLost(then: () => void): () => void;
}
