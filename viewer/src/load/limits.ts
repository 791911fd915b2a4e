/** The limits of a device. */

import { FieldError, REMEDY } from "../errors.js";
import type { DeviceLimits } from "./plan.js";

/** Maximum bytes of textures for a field, and its maximum share of the device's memory, if known. */
const [MOST_BYTES, MEMORY_SHARE] = [1.5 * 2 ** 30, 1 / 4];

/** The default limit of a field. Browsers report memory in gigabytes, or not at all. */
function usualBytes(): number {
  const { deviceMemory } = navigator as { deviceMemory?: number };
  return Math.min(MOST_BYTES, (deviceMemory ?? Infinity) * 2 ** 30 * MEMORY_SHARE);
}

/** The limits from the context of a canvas with no other use, which is released. */
export function limitsOf(canvas: HTMLCanvasElement | OffscreenCanvas): DeviceLimits {
  const gl = canvas.getContext("webgl2") as WebGL2RenderingContext | null;
  if (!gl) throw new FieldError("This browser has no WebGL 2.", REMEDY.browser);
  // More is not needed, and places of slots have 10 bits an axis.
  const side = Math.min(2048, gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number);
  const uniforms = gl.getParameter(gl.MAX_FRAGMENT_UNIFORM_VECTORS) as number;
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return { side, bytes: usualBytes(), uniforms };
}

/** The limits of WebGPU, in browsers without WebGL 2; null if there is no WebGPU either. */
export async function gpuLimits(): Promise<DeviceLimits | null> {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) return null;
  const { maxTextureDimension3D, maxUniformBufferBindingSize } = adapter.limits;
  return { side: Math.min(2048, maxTextureDimension3D), bytes: MOST_BYTES, uniforms: Math.floor(maxUniformBufferBindingSize / 16) };
}
