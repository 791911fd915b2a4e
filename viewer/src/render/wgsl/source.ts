/** The shader in WGSL, for all frameworks on WebGPU. */

import { isNested } from "../../format/parts.js";
import type { Opened } from "../../load/loader.js";
import { networkSource, weighsByUniforms } from "../network.js";
import { defines, unrolled } from "../shader.js";
import type { SAMPLERS } from "../textures.js";
import { applyConditions } from "./conditions.js";
import corner from "./corner.wgsl";
import field from "./field.wgsl";
import march from "./march.wgsl";
import nested from "./nested.wgsl";
import rays from "./rays.wgsl";

/** The function `cornerInClip`, which needs only uniforms. */
export const CORNER: string = corner;

/** The function `marchRay` with everything that it needs, except uniforms and textures. */
export function wgslSource(opened: Opened): string {
  const { metadata, plan, network } = opened;
  const parts = [field, networkSource(opened, "wgsl"), ...(isNested(metadata) ? [nested] : []), rays, march];
  return applyConditions(unrolled(parts.join("\n"), plan.quads), defines(metadata, plan, network, "wgsl"));
}

/** Types of the textures of a field, by name. */
export function textureTypes(opened: Opened): Partial<Record<(typeof SAMPLERS)[number], string>> {
  const { plan, network, mask } = opened;
  return {
    ...(plan.texels.density !== "beside" && { u_density: "texture_3d<f32>" }),
    u_color: "texture_3d<f32>",
    u_table: "texture_3d<u32>",
    u_skipDistances: "texture_3d<u32>",
    ...(plan.directionalQuads > 0 && { u_directional: "texture_3d<f32>" }),
    ...(mask && { u_mask: "texture_3d<f32>" }),
    ...(network.length > 0 && !weighsByUniforms(opened) && { u_weights: "texture_2d<f32>" }),
  };
}
