/** A field's textures in plain WebGL 2, so that every framework on it can draw from them. */

import { blockCounts, type Metadata, type Triple } from "../format/metadata.js";
import { levelOfPart, partsOf } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import { DIRECTIONAL_QUADS, type Plan } from "../load/plan.js";
import { BOXES_BESIDE, macroRoom, macroSides } from "../load/skip.js";
import { packWeights, weighsByUniforms, WEIGHTS_WIDTH } from "./network.js";

/** Names of samplers. That of weights is flat, all others are of volumes. */
export const SAMPLERS = ["u_density", "u_color", "u_directional", "u_table", "u_skipDistances", "u_weights", "u_mask"] as const;

export type Textures = Partial<Record<(typeof SAMPLERS)[number], WebGLTexture>>;

/** Where the table of each level and shell starts along the field's x; behind them all, where they end. */
export function tableStarts(metadata: Metadata, { finest }: Plan): number[] {
  let depth = 0;
  const starts = partsOf(metadata).map((part, number) => {
    if (levelOfPart(metadata, number) < finest) return 0;
    depth += blockCounts(part)[0];
    return depth - blockCounts(part)[0];
  });
  return [...starts, depth];
}

/** Where a box's macro cells start along the field's y and z. */
export function macroStart(metadata: Metadata, box: number): [number, number] {
  const [, y, z] = macroRoom(metadata);
  return [(box % BOXES_BESIDE) * y, Math.floor(box / BOXES_BESIDE) * z];
}

/** Makes the textures of a field: storage alone, but for what does not depend on levels. */
export function allocate(gl: WebGL2RenderingContext, opened: Opened): Textures {
  const { metadata, plan, network, mask } = opened;
  const [x, y, z] = plan.slots.map((slots) => slots * plan.slot);
  const counts = partsOf(metadata).flatMap((part, number) => (levelOfPart(metadata, number) < plan.finest ? [] : [blockCounts(part)]));
  const [, ny, nz] = [0, 1, 2].map((axis) => Math.max(...counts.map((count) => count[axis])));
  const depth = tableStarts(metadata, plan).pop()!;
  return keeping(gl, () => {
    const made: Textures = {
      u_density: cleared(gl, volume(gl, [x, y, z], plan.floatLinear ? gl.R32F : gl.R16F, gl.LINEAR), gl.RED, gl.FLOAT, new Float32Array(1)),
      u_color: cleared(gl, volume(gl, [x, y, z * plan.quads], gl.RGBA16F, gl.LINEAR), gl.RGBA, gl.HALF_FLOAT, new Uint16Array(4)),
      u_table: volume(gl, [nz, ny, depth], gl.R32UI, gl.NEAREST),
      u_skipDistances: volume(gl, macroSides(metadata), gl.RGBA8UI, gl.NEAREST),
    };
    if (plan.directionalRows > 0) {
      const sides = [x, plan.directionalRows * plan.slot, z * DIRECTIONAL_QUADS];
      made.u_directional = cleared(gl, volume(gl, sides, gl.RGBA16F, gl.LINEAR), gl.RGBA, gl.HALF_FLOAT, new Uint16Array(4));
    }
    if (mask) {
      const [x, y, z] = mask.nodes;
      made.u_mask = volume(gl, [z, y, x], gl.R32F, gl.NEAREST);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, 0, z, y, x, gl.RED, gl.FLOAT, mask.values);
    }
    if (network.length > 0 && !weighsByUniforms(opened)) {
      const packed = packWeights(network);
      const rows = Math.ceil(packed.length / 4 / WEIGHTS_WIDTH);
      const texels = new Float32Array(rows * WEIGHTS_WIDTH * 4);
      texels.set(packed);
      made.u_weights = begin(gl, gl.TEXTURE_2D, gl.NEAREST);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, WEIGHTS_WIDTH, rows);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WEIGHTS_WIDTH, rows, gl.RGBA, gl.FLOAT, texels);
    }
    return made;
  });
}

export function free(gl: WebGL2RenderingContext, textures: Textures): void {
  for (const texture of Object.values(textures)) gl.deleteTexture(texture);
}

/**
 * Runs uploads and leaves the context as it was, because frameworks remember what they set. The context knows the answers
 * to these questions itself; that to the alignment of rows it would have to ask the device for.
 */
export function keeping<T>(gl: WebGL2RenderingContext, uploads: () => T): T {
  const unit = gl.getParameter(gl.ACTIVE_TEXTURE) as number;
  const switches = [gl.UNPACK_FLIP_Y_WEBGL, gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL].map((name) => [name, gl.getParameter(name) as boolean] as const);
  // Frameworks use units from the first one on, so that nothing is bound to the last.
  gl.activeTexture(gl.TEXTURE0 + (gl.getParameter(gl.MAX_COMBINED_TEXTURE_IMAGE_UNITS) as number) - 1);
  for (const [name] of switches) gl.pixelStorei(name, false);
  try {
    return uploads();
  } finally {
    for (const [name, value] of switches) gl.pixelStorei(name, value);
    for (const target of [gl.TEXTURE_3D, gl.TEXTURE_2D]) gl.bindTexture(target, null);
    gl.activeTexture(unit);
  }
}

function volume(gl: WebGL2RenderingContext, [x, y, z]: number[] | Triple, format: number, filter: number): WebGLTexture {
  const texture = begin(gl, gl.TEXTURE_3D, filter);
  gl.texStorage3D(gl.TEXTURE_3D, 1, format, x, y, z);
  return texture;
}

/**
 * Writes the first texel of the texture that was made last, before which browsers clear all of it: a software renderer takes
 * seconds for a large one, and nothing waits for it yet.
 */
function cleared(gl: WebGL2RenderingContext, texture: WebGLTexture, format: number, type: number, texel: ArrayBufferView): WebGLTexture {
  gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, 0, 1, 1, 1, format, type, texel);
  return texture;
}

function begin(gl: WebGL2RenderingContext, target: number, filter: number): WebGLTexture {
  const texture = gl.createTexture();
  gl.bindTexture(target, texture);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, filter);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
  return texture;
}
