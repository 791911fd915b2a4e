/** A field's textures in plain WebGL 2, so that every framework on WebGL 2 can draw from them. */

import type { Triple } from "../format/metadata.js";
import { whenDone } from "./fence.js";
import { type DeviceTexture, type Format, FORMAT_BYTES, type TextureDevice, type TextureShape } from "./textureDevice.js";

const known = new WeakMap<WebGL2RenderingContext, GlDevice>();

/** The device of a context; there is one per context. */
export function glDevice(gl: WebGL2RenderingContext): TextureDevice {
  let device = known.get(gl);
  if (!device) known.set(gl, (device = new GlDevice(gl)));
  return device;
}

/** Internal format, format and type of a texel format. */
function names(gl: WebGL2RenderingContext, format: Format): [number, number, number] {
  if (format === "r8unorm") return [gl.R8, gl.RED, gl.UNSIGNED_BYTE];
  if (format === "rgba8unorm") return [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE];
  if (format === "r32float") return [gl.R32F, gl.RED, gl.FLOAT];
  if (format === "r16float") return [gl.R16F, gl.RED, gl.HALF_FLOAT];
  if (format === "rgba16float") return [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT];
  if (format === "rgba32float") return [gl.RGBA32F, gl.RGBA, gl.FLOAT];
  if (format === "r32uint") return [gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT];
  return [gl.RGBA8UI, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE];
}

/** One texel of zeros. */
function texelOf(format: Format): ArrayBufferView {
  const bytes = new ArrayBuffer(FORMAT_BYTES[format]);
  if (format.endsWith("32float")) return new Float32Array(bytes);
  if (format.endsWith("16float")) return new Uint16Array(bytes);
  return format === "r32uint" ? new Uint32Array(bytes) : new Uint8Array(bytes);
}

class GlDevice implements TextureDevice {
  constructor(private readonly gl: WebGL2RenderingContext) {}

  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  /**
   * Frameworks cache the state that they set. The context itself answers these queries, but not that for the row
   * alignment, which would wait for the device.
   */
  keeping<T>(run: () => T): T {
    const { gl } = this;
    const unit = gl.getParameter(gl.ACTIVE_TEXTURE) as number;
    const switches = [gl.UNPACK_FLIP_Y_WEBGL, gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL].map((name) => [name, gl.getParameter(name) as boolean] as const);
    // Frameworks use units from the first one on, so that nothing is bound to the last.
    gl.activeTexture(gl.TEXTURE0 + (gl.getParameter(gl.MAX_COMBINED_TEXTURE_IMAGE_UNITS) as number) - 1);
    for (const [name] of switches) gl.pixelStorei(name, false);
    try {
      return run();
    } finally {
      for (const [name, value] of switches) gl.pixelStorei(name, value);
      for (const target of [gl.TEXTURE_3D, gl.TEXTURE_2D]) gl.bindTexture(target, null);
      gl.activeTexture(unit);
    }
  }

  /**
   * Checks after allocation whether the textures fit: checking immediately would block the page while the device is
   * busy.
   */
  allocating<T>(run: () => T, full: () => void): T {
    const { gl } = this;
    const made = this.keeping(run);
    whenDone(gl, () => {
      let isFull = false;
      for (let error = gl.getError(); error !== gl.NO_ERROR && !gl.isContextLost(); error = gl.getError()) isFull ||= error === gl.OUT_OF_MEMORY;
      if (isFull) full();
    });
    return made;
  }

  make(shape: TextureShape): DeviceTexture {
    const { gl } = this;
    const target = shape.flat ? gl.TEXTURE_2D : gl.TEXTURE_3D;
    const handle = gl.createTexture();
    gl.bindTexture(target, handle);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
    const [storage] = names(gl, shape.format);
    const [x, y, z] = shape.size;
    if (shape.flat) gl.texStorage2D(gl.TEXTURE_2D, 1, storage, x, y);
    else gl.texStorage3D(gl.TEXTURE_3D, 1, storage, x, y, z);
    const texture = { ...shape, handle };
    // Before the first texel is written, browsers clear all of it: a software renderer takes seconds for a large one, and
    // nothing waits for it yet.
    if (!shape.flat) this.write(texture, [0, 0, 0], [1, 1, 1], texelOf(shape.format));
    return texture;
  }

  write({ handle, format, flat }: DeviceTexture, [x, y, z]: Triple, [wide, high, deep]: Triple, values: ArrayBufferView): void {
    const { gl } = this;
    const [, written, type] = names(gl, format);
    // Rows that do not end at 4 bytes are those of few channels.
    const alignment = FORMAT_BYTES[format] < 4 ? (gl.getParameter(gl.UNPACK_ALIGNMENT) as number) : null;
    if (alignment !== null) gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (flat) {
      gl.bindTexture(gl.TEXTURE_2D, handle as WebGLTexture);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, wide, high, written, type, values);
    } else {
      gl.bindTexture(gl.TEXTURE_3D, handle as WebGLTexture);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, x, y, z, wide, high, deep, written, type, values);
    }
    if (alignment !== null) gl.pixelStorei(gl.UNPACK_ALIGNMENT, alignment);
  }

  free({ handle, freed }: DeviceTexture): void {
    freed?.();
    this.gl.deleteTexture(handle as WebGLTexture);
  }

  onLost(then: () => void): () => void {
    const { canvas } = this.gl;
    canvas.addEventListener("webglcontextlost", then);
    return () => canvas.removeEventListener("webglcontextlost", then);
  }
}
