/** The interface of a device for a field's textures. WebGL 2 and WebGPU implement it in separate files. */

import type { Triple } from "../format/metadata.js";

/** Texel formats, by their WebGPU names. */
export type Format = "r8unorm" | "r16float" | "r32float" | "rgba8unorm" | "rgba16float" | "rgba32float" | "r32uint" | "rgba8uint";

export const FORMAT_BYTES: Readonly<Record<Format, number>> = { r8unorm: 1, r16float: 2, r32float: 4, rgba8unorm: 4, rgba16float: 8, rgba32float: 16, r32uint: 4, rgba8uint: 4 };

export interface TextureShape {
  format: Format;
  size: Triple;
  /** Whether the texture is two-dimensional. */
  flat?: boolean;
}

/** A texture as its device made it. Frameworks draw from `handle`. */
export interface DeviceTexture extends TextureShape {
  readonly handle: WebGLTexture | GPUTexture;
  /** Called when the texture is freed, for wrappers. */
  freed?: () => void;
}

/** The textures of one device: a WebGL 2 context or a WebGPU device. */
export interface TextureDevice {
  /** Whether the device was lost, with all its contents. */
  readonly isLost: boolean;
  /** Runs allocations and writes, and leaves the state of the device as frameworks expect it. */
  keeping<T>(run: () => T): T;
  /** Runs the allocations of a field. Calls `full` later if the device has no room for them. */
  allocating<T>(run: () => T, full: () => void): T;
  /** Makes a texture of zeros. Only within `keeping` or `allocating`, like the next two. */
  make(shape: TextureShape): DeviceTexture;
  /** Writes a box of texels from tightly packed rows. */
  write(texture: DeviceTexture, at: Triple, size: Triple, values: ArrayBufferView): void;
  free(texture: DeviceTexture): void;
  /** Calls back when the device is lost. The returned function cancels this. */
  onLost(then: () => void): () => void;
}
