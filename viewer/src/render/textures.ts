/** The textures of a field on a device, and the places of its parts in them. */

import { blockCounts, type Metadata, type Triple } from "../format/metadata.js";
import { levelOfPart, partsOf } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import type { Plan } from "../load/plan.js";
import { BOXES_BESIDE, macroRoom, macroSides } from "../load/skip.js";
import type { Texel } from "../load/texels.js";
import { packWeights, weighsByUniforms, WEIGHTS_WIDTH } from "./network.js";
import type { DeviceTexture, Format, TextureDevice } from "./textureDevice.js";

/** Names of samplers. The texture of weights is 2D, all others are 3D. */
export const SAMPLERS = ["u_density", "u_color", "u_directional", "u_table", "u_skipDistances", "u_weights", "u_mask"] as const;

export type Textures = Partial<Record<(typeof SAMPLERS)[number], DeviceTexture>>;

/** Start of the table of each level and shell along the field's x, followed by the end of the last one. */
export function tableStarts(metadata: Metadata, { finest }: Plan): number[] {
  let depth = 0;
  const starts = partsOf(metadata).map((part, number) => {
    if (levelOfPart(metadata, number) < finest) return 0;
    depth += blockCounts(part)[0];
    return depth - blockCounts(part)[0];
  });
  return [...starts, depth];
}

/** Start of a box's macro cells along the field's y and z. */
export function macroStart(metadata: Metadata, box: number): [number, number] {
  const [, y, z] = macroRoom(metadata);
  return [(box % BOXES_BESIDE) * y, Math.floor(box / BOXES_BESIDE) * z];
}

/** Formats of one channel, and of four. */
const ONE: Readonly<Record<Texel, Format>> = { codes: "r8unorm", halves: "r16float", floats: "r32float" };
const FOUR: Readonly<Record<Texel, Format>> = { codes: "rgba8unorm", halves: "rgba16float", floats: "rgba32float" };

/** Allocates the textures of a field. Only those that do not depend on levels are filled. */
export function allocate(device: TextureDevice, opened: Opened): Textures {
  const { metadata, plan, network, mask } = opened;
  const [x, y, z] = plan.slots.map((slots) => slots * plan.slot);
  const counts = partsOf(metadata).flatMap((part, number) => (levelOfPart(metadata, number) < plan.finest ? [] : [blockCounts(part)]));
  const [, ny, nz] = [0, 1, 2].map((axis) => Math.max(...counts.map((count) => count[axis])));
  const depth = tableStarts(metadata, plan).pop()!;
  const volume = (format: Format, size: Triple) => device.make({ format, size });
  const { texels } = plan;
  const made: Textures = {
    ...(texels.density !== "beside" && { u_density: volume(ONE[texels.density], [x, y, z]) }),
    u_color: volume(FOUR[texels.color], [x, y, z * plan.quads]),
    u_table: volume("r32uint", [nz, ny, depth]),
    u_skipDistances: volume("rgba8uint", macroSides(metadata)),
  };
  if (plan.directionalQuads > 0) made.u_directional = volume(FOUR[texels.directional], [x, plan.directionalRows * plan.slot, z * plan.directionalQuads]);
  if (mask) {
    const [x, y, z] = mask.nodes;
    made.u_mask = volume(mask.values instanceof Uint8Array ? "r8unorm" : "r32float", [z, y, x]);
    device.write(made.u_mask, [0, 0, 0], [z, y, x], mask.values);
  }
  if (network.length > 0 && !weighsByUniforms(opened)) {
    const packed = packWeights(network);
    const rows = Math.ceil(packed.length / 4 / WEIGHTS_WIDTH);
    const texels = new Float32Array(rows * WEIGHTS_WIDTH * 4);
    texels.set(packed);
    const size: Triple = [WEIGHTS_WIDTH, rows, 1];
    made.u_weights = device.make({ format: "rgba32float", size, flat: true });
    device.write(made.u_weights, [0, 0, 0], size, texels);
  }
  return made;
}
