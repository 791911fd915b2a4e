/** The shader's uniforms: those fixed by the field, and those that follow the camera. */

import { type Encoding, type Metadata, storedGroups } from "../format/metadata.js";
import { boxesOf, extentOf, isNested, outerBounds, partsOf } from "../format/parts.js";
import { lastSample } from "../format/shells.js";
import { interpolatedDensity } from "../load/interpolated.js";
import type { Opened } from "../load/loader.js";
import type { Plan } from "../load/plan.js";
import type { Look } from "../load/residents.js";
import { boxNodes, macroCounts, macroEdge } from "../load/skip.js";
import { decoding, encodedKinds, texelOf } from "../load/texels.js";
import { inverse, isParallel, lensOf, linearPart, type Matrix, product, unturned } from "./matrices.js";
import { packWeights, weighsByUniforms } from "./network.js";
import { decodeNumber, OUTPUT } from "./shader.js";
import { tableStarts } from "./textures.js";

/** Values by name; vectors, matrices and arrays of them as flat lists. */
export type Uniforms = Record<string, number | boolean | number[]>;

/** The geometry of a picture. World and camera axes are right-handed; cameras look along -z. */
export interface View {
  /** Transforms of the field and of the camera. */
  world: Matrix;
  camera: Matrix;
  projection: Matrix;
  /** The lower left corner of the picture in the target, its width and height. */
  viewport: number[];
  /** Whether the target takes linear values. */
  isLinear: boolean;
  /**
   * Factor and shift from depth in clip space to depth of the target. Without a shift, clip space ranges from 0 to 1.
   */
  depth: [number, number];
  /** Logarithmic depth is `factor * log2(shift + scale * distance)`; all 0 for other depths. */
  logarithm: readonly [factor: number, shift: number, scale: number];
  /** Whether the target's rows run downward. */
  isDownward?: boolean;
}

/** What to show of a field. */
export interface Shown {
  finest: number;
  fixedLevel: number | null;
  keepsRange: boolean;
  /** One of `OUTPUT`. */
  output?: number;
  /** False for a march without skipping. */
  skips?: boolean;
  /** Half a pixel of the picture, in pixels of the target. */
  halfPixel?: number;
}

/** For depths that are not logarithmic. */
export const NO_LOGARITHM = [0, 0, 0] as const;

const PLACE = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
/** The view before the first picture. */
export const NOWHERE: View = { world: PLACE, camera: PLACE, projection: PLACE, viewport: [0, 0, 1, 1], isLinear: false, depth: [0, 0], logarithm: NO_LOGARITHM };

/** Logarithmic depth of a distance plus 1, up to the far plane, as in WebGL frameworks. */
export function logarithmOf(far: number): [number, number, number] {
  return [1 / Math.log2(far + 1), 1, 1];
}

/** The length of a ray without a far plane. */
const BEYOND = 1e30;

/** A corner of the sampled box, as fractions of the outermost box. */
function sampledShare(metadata: Metadata, corner: "min" | "max"): number[] {
  const outer = outerBounds(metadata);
  const extent = extentOf(outer);
  return (metadata.march.sampled ?? outer)[corner].map((value, axis) => (value - outer.min[axis]) / extent[axis]);
}

/** Uniforms that do not change. */
export function fieldUniforms(opened: Opened): Uniforms {
  const { metadata, plan, network, mask } = opened;
  const { levels, march, activation, level_of_detail: rule, bounds } = metadata;
  const parts = partsOf(metadata);
  const boxes = boxesOf(metadata);
  const empty = (encoding: Encoding | null) => encoding?.empty ?? 0;
  const starts = tableStarts(metadata, plan);
  const values: Uniforms = {
    u_slot: plan.slot,
    u_slotsDeep: plan.slots[2],
    u_nodes: parts.flatMap((level) => [...level.dimensions, level.block_size]),
    u_levels: parts.flatMap((level, i) => [starts[i], level.density ? 1 : 0, decodeNumber(level.density?.decode ?? "raw_density"), (level.anisotropy ? 1 : 0) + (level.directional ? 2 : 0)]),
    u_codes: parts.flatMap((_, part) => codesOf(metadata, plan, part)),
    u_empty: parts.flatMap(({ density, diffuse, features, directional }) => {
      const of = density ? interpolatedDensity(activation, density.decode)(density.empty) : 0;
      return [of, empty(diffuse), empty(features), empty(directional ?? null)];
    }),
    u_emptyBands: parts.flatMap(({ bands }) => [0, 1, 2].map((band) => empty(bands?.[band] ?? null))),
    u_activation: [activation.shift, activation.interval],
    u_thresholds: [march.alpha_threshold, march.color_threshold],
    u_lowest: sampledShare(metadata, "min"),
    u_highest: sampledShare(metadata, "max"),
    u_step: march.stepsize,
    u_interval: march.stepsize * march.voxel_size,
    u_perVoxel: (march.voxel ?? [0, 0, 0].fill(march.voxel_size)).map((edge) => 1 / edge),
    u_mostSteps: lastSample(metadata),
    u_levelOfDetail: [rule.factor, rule.bias, Math.min(levels.length - 1, rule.most ?? Infinity)],
    ...(rule.bends && { u_bends: rule.bends.flat() }),
    ...(weighsByUniforms(opened) && { u_network: packWeights(network) }),
    u_macroCounts: boxes.flatMap((_, box) => macroCounts(metadata, box)),
    u_macroScale: boxes.flatMap((_, box) => boxNodes(metadata, box).map((nodes) => (nodes - 1) / macroEdge(metadata, box))),
    ...(isNested(metadata) && nestedUniforms(metadata)),
  };
  if (mask) {
    const scale = mask.scale.map((scale, axis) => scale * (bounds.max[axis] - bounds.min[axis]));
    values.u_toMask = [scale[0], 0, 0, 0, scale[1], 0, 0, 0, scale[2]];
    values.u_maskShift = mask.shift.map((shift, axis) => shift + mask.scale[axis] * bounds.min[axis]);
    values.u_maskNearest = mask.lookup === "nearest";
    values.u_maskThreshold = mask.threshold;
  }
  return values;
}

/** Parameters for decoding the texels of a part, group by group. */
function codesOf(metadata: Metadata, { texels }: Plan, part: number): number[] {
  const groups = storedGroups(metadata, part);
  return encodedKinds(metadata).flatMap((kind) => {
    return decoding(texelOf(texels, kind), groups.find((group) => group.kind === kind)?.encoding ?? null);
  });
}

/** Uniforms of nested boxes that do not follow the camera. */
function nestedUniforms(metadata: Metadata): Uniforms {
  const outer = extentOf(outerBounds(metadata));
  const inner = extentOf(metadata.bounds);
  return {
    u_boxScale: boxesOf(metadata).flatMap((box) => extentOf(box).map((extent, axis) => outer[axis] / extent)),
    u_voxels: metadata.levels[0].dimensions.map((nodes, axis) => (nodes * outer[axis]) / inner[axis]),
  };
}

/** A point as fractions of a box. */
function sharesOf(point: readonly number[], box: Metadata["bounds"]): number[] {
  return extentOf(box).map((extent, axis) => (point[axis] - box.min[axis]) / extent);
}

/**
 * The position of a view's camera in the field's axes, and its visible cone; with parallel rays, it sees everything.
 */
export function lookOf({ world, camera, projection }: View): Look {
  const toLocal = product(inverse(world), camera);
  const back = toLocal.slice(8, 11);
  const length = Math.hypot(...back);
  const [wide, high, aside, above] = lensOf(projection).map(Math.abs);
  const cosine = isParallel(projection) ? -1 : 1 / Math.hypot(1, wide + aside, high + above);
  return { place: toLocal.slice(12, 15), forward: back.map((value) => -value / length), cosine };
}

/** The far end of depth in clip space, and the sign towards it. */
function farEnd({ projection, depth }: View): { at: number; sign: 1 | -1 } {
  const grows = isParallel(projection) ? projection[10] < 0 : projection[14] < 0;
  return grows ? { at: 1, sign: 1 } : { at: depth[1] === 0 ? 0 : -1, sign: -1 };
}

/** Uniforms of one picture. */
export function viewUniforms(metadata: Metadata, view: View, shown: Shown): Uniforms {
  const { march, levels } = metadata;
  const bounds = outerBounds(metadata);
  const { world, camera, projection, depth } = view;
  // Directions keep their length on the way from the camera, so that distances along them are the same.
  const toLocal = product(inverse(world), camera);
  const extent = extentOf(bounds);
  const place = toLocal.slice(12, 15);
  const far = farEnd(view);
  // Before parallel rays start, there is something as well.
  const near = far.sign < 0 ? 1 : depth[1] === 0 ? 0 : -1;
  const first = isParallel(projection) ? (projection[14] - near) / projection[10] : 0;
  const [left, low, wide, high] = view.viewport;
  return {
    u_toClip: product(projection, product(inverse(camera), world)),
    u_toLocal: linearPart(toLocal),
    u_toBox: linearPart(toLocal).map((value, at) => value / extent[at % 3]),
    u_origin: sharesOf(place, bounds),
    ...(isNested(metadata) && { u_boxOrigin: boxesOf(metadata).flatMap((box) => sharesOf(place, box)) }),
    // The network's direction is the world's through the inverse of the rotation alone.
    u_toView: linearPart(product(unturned(world), camera)),
    u_lens: lensOf(projection),
    u_isParallel: isParallel(projection),
    u_viewport: view.isDownward ? [left, low + high, wide, -high] : view.viewport,
    u_linear: view.isLinear,
    u_depthOfT: [depth[1] + depth[0] * (isParallel(projection) ? projection[14] : -projection[10]), depth[0] * (isParallel(projection) ? -projection[10] : projection[14])],
    u_logarithm: [...view.logarithm],
    u_farEnd: [far.at, far.sign],
    u_farDepth: depth[1] + depth[0] * far.at,
    u_finest: shown.finest,
    u_fixedLevel: shown.fixedLevel === null ? -1 : Math.min(Math.max(shown.finest, shown.fixedLevel), levels.length - 1),
    u_range: [shown.keepsRange ? march.near : first, (shown.keepsRange ? march.far : null) ?? BEYOND],
    u_output: shown.output ?? OUTPUT.color,
    u_skips: shown.skips ?? true,
    u_halfPixel: shown.halfPixel ?? 0.5,
  };
}
