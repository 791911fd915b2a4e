/** What this device's WebGL can hold. */

import { FieldError, REMEDY } from "./errors.js";
import type { DeviceLimits } from "./load/plan.js";

/** Bytes of textures that a page should not go beyond. */
const MOST_BYTES = 1.5 * 2 ** 30;

let known: DeviceLimits | null = null;

/** Asked once, of a context that is given back. */
export function deviceLimits(): DeviceLimits {
  if (known) return known;
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) throw new FieldError("This browser has no WebGL 2.", REMEDY.device);
  // More is not needed, and places of slots have 10 bits an axis.
  const side = Math.min(2048, gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number);
  const floatLinear = gl.getExtension("OES_texture_float_linear") !== null;
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return (known = { side, floatLinear, bytes: MOST_BYTES });
}
