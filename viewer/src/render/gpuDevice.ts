/** A field's textures in plain WebGPU. */

import type { Triple } from "../format/metadata.js";
import { type DeviceTexture, FORMAT_BYTES, type TextureDevice, type TextureShape } from "./textureDevice.js";

/** Flags of `GPUTextureUsage`, which TypeScript does not know. */
const [BINDING, WRITTEN] = [4, 2];

const known = new WeakMap<GPUDevice, GpuDevice>();

/** The textures of a WebGPU device. */
export function gpuDevice(device: GPUDevice): TextureDevice {
  let found = known.get(device);
  if (!found) known.set(device, (found = new GpuDevice(device)));
  return found;
}

class GpuDevice implements TextureDevice {
  isLost = false;
  private readonly listeners = new Set<() => void>();

  constructor(private readonly device: GPUDevice) {
    void device.lost.then(() => {
      this.isLost = true;
      for (const then of [...this.listeners]) then();
    });
  }

  /** WebGPU has no state to restore. */
  keeping<T>(run: () => T): T {
    return run();
  }

  allocating<T>(run: () => T, full: () => void): T {
    const { device } = this;
    device.pushErrorScope("out-of-memory");
    const made = run();
    device.popErrorScope().then(
      (error) => error && full(),
      // The device was lost meanwhile, of which others tell.
      () => {},
    );
    return made;
  }

  make(shape: TextureShape): DeviceTexture {
    const usage = BINDING | WRITTEN;
    const [width, height, depthOrArrayLayers] = shape.size;
    const handle = this.device.createTexture({ size: { width, height, depthOrArrayLayers }, dimension: shape.flat ? "2d" : "3d", format: shape.format, usage });
    return { ...shape, handle };
  }

  write({ handle, format }: DeviceTexture, [x, y, z]: Triple, [width, height, depthOrArrayLayers]: Triple, values: ArrayBufferView): void {
    const rows = { bytesPerRow: width * FORMAT_BYTES[format], rowsPerImage: height };
    this.device.queue.writeTexture({ texture: handle as GPUTexture, origin: { x, y, z } }, values as ArrayBufferView<ArrayBuffer>, rows, { width, height, depthOrArrayLayers });
  }

  free({ handle, freed }: DeviceTexture): void {
    freed?.();
    (handle as GPUTexture).destroy();
  }

  onLost(then: () => void): () => void {
    this.listeners.add(then);
    return () => this.listeners.delete(then);
  }
}
