/** Written by `cargo xtask generate` from `formats/container.toml`. */

import { boolean, choice, finite, fromZero, list, nullable, oneOf, optional, positive, record, share, text, whole } from "./rules.js";

export type Triple = [number, number, number];

/** The major version that this reader knows. */
export const MAJOR = 1;
/** Required features, from bit 0 on. */
export const FEATURES = ["inherited_blocks", "linear_values", "bent_rule", "directional", "anisotropy", "nested_boxes"] as const;
export type Feature = (typeof FEATURES)[number];
/** Every chunk type. */
export const KNOWN: readonly string[] = ["META", "VMLP", "MASK", "prov", "thmb", "TABL", "DENS", "DIFF", "FEAT", "BNDA", "BNDB", "BNDC", "DIRB", "ANIS"];
/** Groups of values, in the order of their atlases: the encoding is a level's `key`, of a list the `item` of it. */
export const GROUPS = [
  { name: "density", kind: "DENS", key: "density", channels: 1, color: false },
  { name: "diffuse", kind: "DIFF", key: "diffuse", channels: 3, color: true },
  { name: "features", kind: "FEAT", key: "features", channels: "features", color: true },
  { name: "band_1", kind: "BNDA", key: "bands", item: 0, channels: 9, color: true },
  { name: "band_2", kind: "BNDB", key: "bands", item: 1, channels: 15, color: true },
  { name: "band_3", kind: "BNDC", key: "bands", item: 2, channels: 21, color: true },
  { name: "directional", kind: "DIRB", key: "directional", channels: 3, color: true },
  { name: "anisotropy", kind: "ANIS", key: "anisotropy", channels: 5, color: false },
] as const;

export interface Box {
  max: Triple;
  min: Triple;
}

/** `sigma = softplus(raw + shift)` or `max(raw, 0)`, `alpha = 1 - exp(-sigma * interval)`. */
export interface Activation {
  /** Added to raw density before softplus; 0 with `relu`. */
  shift: number;
  /** Step length divided by the base voxel size. */
  interval: number;
  /** The values that are interpolated between nodes. */
  order: "raw" | "density" | "opacity";
  /** Raw density to density; absent for softplus. */
  function?: "relu";
}

/** Steps along a ray. */
export interface March {
  /** Step length in voxels. */
  stepsize: number;
  /** Edge, in world units, of a cube with the volume of a trained voxel. `stepsize * voxel_size` is the interval over which opacities are stated. */
  voxel_size: number;
  /** Edges, in world units, of the voxels that are the unit of steps; absent for cubes of `voxel_size`. Along a unit direction `d`, a step is `stepsize / |d / voxel|` long. */
  voxel?: Triple;
  /** Nearest start of rays, as distance along the axis of the camera. */
  near: number;
  /** Farthest start of rays in the box, in the same units; null is unlimited. */
  far: number | null;
  /** Samples of at most this weight add no colour. */
  color_threshold: number;
  /** Samples of at most this opacity are dropped. */
  alpha_threshold: number;
  /** The part of the box in which rays are sampled; absent for all of it. There are no samples outside it, though there may be nodes. */
  sampled?: Box;
}

/** `lambda = clamp(line + sum of by * max(0, x - at), 0, min(last level, most))`, where `x = log2(rho)`, `line = factor * x + bias`, the sum is over the `bends`, and `rho` is the footprint of half a pixel in voxels of size `(max - min) / N`, doubled. */
export interface LevelOfDetail {
  /** 1/3 in the paper, 1/2 in the research code, 1 for mipmaps. */
  factor: number;
  /** Added after the factor. */
  bias: number;
  /** The point of the neighbouring ray to which the footprint is measured. */
  aside: "same_distance" | "same_index";
  /** An upper bound in addition to the last level, if any. */
  most: number | null;
  /** Bends of the line; absent if there are none. */
  bends?: [number, number][];
}

/** The network of chunk `VMLP`. */
export interface NetworkShape {
  /** Widths from input to output. */
  widths: number[];
  /** Octaves of the direction embedding. */
  frequencies: number;
  /** The rest of the first layer's input, after the embedding. */
  input: "diffuse_and_features" | "features";
}

export interface Harmonics {
  clamp: "zero" | "none" | "sigmoid";
  degree: number;
  kind: "spherical_harmonics";
  offset: number;
  where: "ray" | "sample";
}

/** The encoding of one group of one level. */
export interface Encoding {
  /** Number type of codes. */
  number: "u8" | "u16" | "f16" | "f32";
  /** Bits per code: 1 to 16, or those of the float. */
  bits: number;
  /** Value of the middle code; 0 for floats. */
  center: number;
  /** Difference between the values of neighbouring codes at the middle; 0 for floats. */
  step: number;
  /** Growth of that difference towards the ends; 0 for floats. */
  curve: number;
  /** Value of nodes in blocks that are not stored. */
  empty: number;
  /** True if code 0 means `empty`. */
  empty_code: boolean;
  /** Meaning of decoded values. */
  decode: "logit" | "linear" | "band_0" | "band_1" | "band_2" | "band_3" | "directional_logit" | "directional_sqrt_depth" | "raw_density" | "sqrt_optical_depth" | "opacity";
  /** Largest error of a decoded value at a retained node: in opacity over one interval for density, in colour (0 to 1) otherwise. */
  max_error: number;
}

/** One level. */
export interface LevelMetadata {
  /** Nodes along x, y and z. */
  dimensions: Triple;
  /** Nodes along a block's edge. */
  block_size: number;
  /** The box of a shell; left out of levels. */
  bounds?: Box;
  /** Stored blocks, including those that inherit their colours. */
  blocks_stored: number;
  /** Blocks that inherit their colours from the next coarser level; absent if there are none. */
  blocks_filled?: number;
  /** Density; null if the level uses that of level 0. */
  density: Encoding | null;
  /** Diffuse colour. */
  diffuse: Encoding;
  /** Specular features; null if there are none. */
  features: Encoding | null;
  /** Coefficients of harmonics, band 1 first; absent if there are none. */
  bands?: Encoding[];
  /** Directional brightness; absent if there is none. */
  directional?: Encoding;
  /** Anisotropy of density; absent if there is none. */
  anisotropy?: Encoding;
}

/** Everything except bulk data. Levels are ordered fine to coarse. */
export interface Metadata {
  /** The box of level 0, in training axes; without shells, that of every level. */
  bounds: Box;
  /** Raw density to opacity. */
  activation: Activation;
  /** Steps along a ray. */
  march: March;
  /** The rule for a step's length at each level. */
  step_rule: "constant" | "level_of_detail";
  /** The rule for the level that a sample reads. */
  level_of_detail: LevelOfDetail;
  /** Mixing of two levels. */
  blend: "before_activation" | "after_activation";
  /** Colour behind the field. */
  background: Triple;
  /** Color space of colours. */
  color_space: "srgb_display";
  /** Colour channels of a node beyond three: specular features, or coefficients of harmonics beyond band 0. */
  features: number;
  /** View-dependent colour; null for a diffuse field. */
  view: Harmonics | NetworkShape | null;
  /** True if samples outside the free-space mask in chunk `MASK` are dropped. */
  free_space: boolean;
  /** Blocks up to this opacity over one interval were dropped. Renderers do not apply it to samples. */
  alpha_threshold: number;
  /** Name of the filter that made the coarser levels. */
  filter: string;
  /** Fine to coarse. */
  levels: LevelMetadata[];
  /** Shells of levels 1, 2, ...: what they show around smaller boxes; absent without nested boxes. */
  shells?: LevelMetadata[];
}

const BOX_RULE = record({
  max: list(3, 3, finite),
  min: list(3, 3, finite),
});
const ACTIVATION_RULE = record({
  shift: finite,
  interval: positive,
  order: oneOf("raw", "density", "opacity"),
  function: optional(oneOf("relu")),
});
const MARCH_RULE = record({
  stepsize: positive,
  voxel_size: positive,
  voxel: optional(list(3, 3, positive)),
  near: fromZero,
  far: nullable(finite),
  color_threshold: share,
  alpha_threshold: share,
  sampled: optional(BOX_RULE),
});
const LEVEL_OF_DETAIL_RULE = record({
  factor: positive,
  bias: finite,
  aside: oneOf("same_distance", "same_index"),
  most: nullable(fromZero),
  bends: optional(list(1, 6, list(2, 2, finite))),
});
const NETWORK_RULE = record({
  widths: list(2, 32, whole(1, 4096)),
  frequencies: whole(0, 32),
  input: oneOf("diffuse_and_features", "features"),
});
const HARMONICS_RULE = record({
  clamp: oneOf("zero", "none", "sigmoid"),
  degree: whole(0, 3),
  kind: oneOf("spherical_harmonics"),
  offset: finite,
  where: oneOf("ray", "sample"),
});
const ENCODING_RULE = record({
  number: oneOf("u8", "u16", "f16", "f32"),
  bits: whole(1, 32),
  center: finite,
  step: finite,
  curve: finite,
  empty: finite,
  empty_code: boolean,
  decode: oneOf("logit", "linear", "band_0", "band_1", "band_2", "band_3", "directional_logit", "directional_sqrt_depth", "raw_density", "sqrt_optical_depth", "opacity"),
  max_error: fromZero,
});
const LEVEL_RULE = record({
  dimensions: list(3, 3, whole(2, 65536)),
  block_size: whole(1, 64),
  bounds: optional(BOX_RULE),
  blocks_stored: whole(0, 8589934592),
  blocks_filled: optional(whole(1, 8589934592)),
  density: nullable(ENCODING_RULE),
  diffuse: ENCODING_RULE,
  features: nullable(ENCODING_RULE),
  bands: optional(list(1, 3, ENCODING_RULE)),
  directional: optional(ENCODING_RULE),
  anisotropy: optional(ENCODING_RULE),
});
export const METADATA_RULE = record({
  bounds: BOX_RULE,
  activation: ACTIVATION_RULE,
  march: MARCH_RULE,
  step_rule: oneOf("constant", "level_of_detail"),
  level_of_detail: LEVEL_OF_DETAIL_RULE,
  blend: oneOf("before_activation", "after_activation"),
  background: list(3, 3, finite),
  color_space: oneOf("srgb_display"),
  features: whole(0, 61),
  view: nullable(choice("kind", HARMONICS_RULE, NETWORK_RULE)),
  free_space: boolean,
  alpha_threshold: share,
  filter: text,
  levels: list(1, 32, LEVEL_RULE),
  shells: optional(list(1, 31, LEVEL_RULE)),
});
