/** The shader's uniforms: what the field fixes, and what follows the camera. */

import { Matrix3, Matrix4, type PerspectiveCamera, Quaternion, SRGBColorSpace, Vector2, Vector3, Vector4, type WebGLRenderer } from "three";
import type { Encoding, Metadata } from "../format/metadata.js";
import { interpolatedDensity } from "../load/interpolated.js";
import type { Opened } from "../load/loader.js";
import { macroCounts, macroEdge } from "../load/skip.js";
import type { Atlas } from "./atlas.js";
import { decodeNumber } from "./shader.js";

export type Uniforms = Record<string, { value: any }>;

/** As far as a ray without a far plane goes. */
export const BEYOND = 1e30;

/** A corner of the part of the box that rays are sampled in, 0 to 1. */
function sampledShare({ bounds, march }: Metadata, corner: "min" | "max"): Vector3 {
  const at = (march.sampled ?? bounds)[corner];
  return new Vector3(...at.map((value, axis) => (value - bounds.min[axis]) / (bounds.max[axis] - bounds.min[axis])));
}

/** Uniforms that stay as they are. */
export function fieldUniforms({ metadata, plan, mask }: Opened, atlas: Atlas): Uniforms {
  const { levels, march, activation, level_of_detail: rule, bounds } = metadata;
  const [x, y, z] = levels[0].dimensions.map((nodes) => nodes + 1);
  const edge = macroEdge(metadata);
  const empty = (encoding: Encoding | null) => encoding?.empty ?? 0;
  const values: Record<string, unknown> = {
    u_density: atlas.density,
    u_color: atlas.color,
    u_table: atlas.table,
    u_skipDistances: atlas.skipDistances,
    u_weights: atlas.weights,
    u_slot: plan.slot,
    u_slotsDeep: plan.slots[2],
    u_nodes: levels.flatMap((level) => [...level.dimensions, level.block_size]),
    u_levels: levels.flatMap((level, i) => [atlas.tableStart[i], level.density ? 1 : 0, decodeNumber(level.density?.decode ?? "raw_density")]),
    u_empty: levels.map(({ density, diffuse, features, bands }) => {
      const of = density ? interpolatedDensity(activation, density.decode)(density.empty) : 0;
      return new Vector3(of, empty(diffuse), empty(features ?? bands?.[0] ?? null));
    }),
    u_activation: new Vector2(activation.shift, activation.interval),
    u_range: new Vector2(),
    u_thresholds: new Vector2(march.alpha_threshold, march.color_threshold),
    u_lowest: sampledShare(metadata, "min"),
    u_highest: sampledShare(metadata, "max"),
    u_step: march.stepsize,
    u_interval: march.stepsize * march.voxel_size,
    u_perVoxel: new Vector3(...(march.voxel ?? [0, 0, 0].fill(march.voxel_size)).map((edge) => 1 / edge)),
    u_mostSteps: Math.floor(Math.hypot(x, y, z) / march.stepsize),
    u_levelOfDetail: new Vector3(rule.factor, rule.bias, Math.min(levels.length - 1, rule.most ?? Infinity)),
    ...(rule.bends && { u_bends: rule.bends.map(([at, by]) => new Vector2(at, by)) }),
    u_macroCounts: macroCounts(metadata),
    u_macroScale: new Vector3(...levels[0].dimensions.map((nodes) => (nodes - 1) / edge)),
    u_finest: 0,
    u_fixedLevel: -1,
    u_output: 0,
    u_skips: true,
    u_halfPixel: 0.5,
    u_viewport: new Vector4(),
    u_lens: new Vector4(),
    u_origin: new Vector3(),
    u_toBox: new Matrix3(),
    u_toLocal: new Matrix3(),
    u_toView: new Matrix3(),
    u_depthOfT: new Vector2(),
    u_linear: false,
  };
  if (mask) {
    const scale = mask.scale.map((scale, axis) => scale * (bounds.max[axis] - bounds.min[axis]));
    const shift = mask.shift.map((shift, axis) => shift + mask.scale[axis] * bounds.min[axis]);
    values.u_mask = atlas.mask;
    values.u_toMask = new Matrix3().set(scale[0], 0, 0, 0, scale[1], 0, 0, 0, scale[2]);
    values.u_maskShift = new Vector3(...shift);
    values.u_maskNearest = mask.lookup === "nearest";
    values.u_maskThreshold = mask.threshold;
  }
  return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, { value }]));
}

const toLocal = new Matrix4();
const rotation = new Matrix4();
const shares = new Matrix3();
const turned = new Quaternion();
const [unused, origin, low, high] = [new Vector3(), new Vector3(), new Vector3(), new Vector3()];

/** Uniforms of one camera's picture. `world` is the field's place. */
export function viewUniforms(uniforms: Uniforms, metadata: Metadata, camera: PerspectiveCamera, world: Matrix4, renderer: WebGLRenderer): void {
  // Directions keep their length on the way from the camera, so that distances along them are the same.
  toLocal.copy(world).invert().multiply(camera.matrixWorld);
  uniforms.u_toLocal.value.setFromMatrix4(toLocal);
  low.set(...metadata.bounds.min);
  high.set(...metadata.bounds.max).sub(low);
  origin.setFromMatrixPosition(toLocal);
  uniforms.u_origin.value.copy(origin).sub(low).divide(high);
  const toBox: Matrix3 = uniforms.u_toBox.value.setFromMatrix4(toLocal);
  shares.set(1 / high.x, 0, 0, 0, 1 / high.y, 0, 0, 0, 1 / high.z);
  toBox.premultiply(shares);
  // The network's direction is the world's through the inverse of the rotation alone.
  world.decompose(unused, turned, origin);
  rotation.makeRotationFromQuaternion(turned.invert()).multiply(camera.matrixWorld);
  uniforms.u_toView.value.setFromMatrix4(rotation);
  uniforms.u_linear.value = renderer.getRenderTarget() !== null || renderer.outputColorSpace !== SRGBColorSpace;
  const projection = camera.projectionMatrix.elements;
  uniforms.u_lens.value.set(1 / projection[0], 1 / projection[5], projection[8] / projection[0], projection[9] / projection[5]);
  // An eye of a headset has a part of the picture.
  const { viewport } = camera as PerspectiveCamera & { viewport?: Vector4 };
  if (viewport) uniforms.u_viewport.value.copy(viewport);
  else if (renderer.getCurrentViewport(uniforms.u_viewport.value).z === 0) {
    // Unknown to renderers whose size was never set.
    const { width, height } = renderer.domElement;
    uniforms.u_viewport.value.set(0, 0, width, height);
  }
  // Named `reverseDepthBuffer` before release 182.
  const { reversedDepthBuffer, reverseDepthBuffer } = renderer.capabilities as typeof renderer.capabilities & { reverseDepthBuffer?: boolean };
  const [scale, shift] = (reversedDepthBuffer ?? reverseDepthBuffer) ? [1, 0] : [0.5, 0.5];
  uniforms.u_depthOfT.value.set(shift - scale * projection[10], scale * projection[14]);
}
