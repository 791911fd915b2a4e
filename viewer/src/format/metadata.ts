/** The metadata, chunk META: section 4 of `formats/mipvog.md`. */

import { FieldError, REMEDY } from "../errors.js";

export type Triple = [number, number, number];

/** What values mean. */
const DECODES = ["logit", "linear", "band_0", "band_1", "band_2", "band_3", "directional_logit", "directional_sqrt_depth", "raw_density", "sqrt_optical_depth", "opacity"] as const;

/** How the values of one group of one level are stored. */
export interface Encoding {
  number: "u8" | "u16" | "f16" | "f32";
  bits: number;
  center: number;
  step: number;
  curve: number;
  empty: number;
  empty_code: boolean;
  decode: (typeof DECODES)[number];
  max_error: number;
}

export interface LevelMetadata {
  dimensions: Triple;
  block_size: number;
  blocks_stored: number;
  /** Blocks whose colours are inherited from the next coarser level; left out where there are none. */
  blocks_filled?: number;
  density: Encoding | null;
  diffuse: Encoding;
  features: Encoding | null;
  /** Coefficients of bands 1 to 3 of harmonics; left out where there are none. */
  bands?: Encoding[];
  /** Directional brightness: three values; left out where there is none. */
  directional?: Encoding;
  /** Anisotropy of density: five values; left out where there is none. */
  anisotropy?: Encoding;
}

/** The shape of the network. */
export interface NetworkShape {
  frequencies: number;
  input: "diffuse_and_features" | "features";
  widths: number[];
}

/** The rules of harmonics. */
export interface Harmonics {
  kind: "spherical_harmonics";
  degree: number;
  where: "ray" | "sample";
  offset: number;
  clamp: "zero" | "none" | "sigmoid";
}

export interface Metadata {
  bounds: { min: Triple; max: Triple };
  activation: { interval: number; order: "raw" | "density" | "opacity"; shift: number; function?: "relu" };
  march: {
    alpha_threshold: number;
    color_threshold: number;
    far: number | null;
    near: number;
    sampled?: { min: Triple; max: Triple };
    stepsize: number;
    /** Edges of the voxels that steps are counted in, where they are no cubes of `voxel_size`. */
    voxel?: Triple;
    voxel_size: number;
  };
  step_rule: "constant" | "level_of_detail";
  level_of_detail: { aside: "same_distance" | "same_index"; bias: number; factor: number; most: number | null; bends?: [number, number][] };
  blend: "before_activation" | "after_activation";
  background: Triple;
  color_space: "srgb_display";
  features: number;
  view: null | NetworkShape | Harmonics;
  free_space: boolean;
  alpha_threshold: number;
  filter: string;
  /** Fine to coarse. */
  levels: LevelMetadata[];
}

/** What a value of the metadata must be; throws where it is not. */
type Rule = ((value: unknown, key: string) => void) & { optional?: true };

function fail(key: string, expected: string): never {
  throw new FieldError(`The metadata's ${key || "content"} should be ${expected}.`);
}

const number = (expected: string, holds: (value: number) => boolean): Rule => (value, key) => {
  if (typeof value !== "number" || !Number.isFinite(Math.fround(value)) || !holds(value)) fail(key, expected);
};
const whole = (from: number, to: number) =>
  number(`a whole number from ${from} to ${to}`, (value) => Number.isInteger(value) && value >= from && value <= to);
const finite = number("a finite number", () => true);
const positive = number("a positive number", (value) => value > 0);
const share = number("a number from 0 to below 1", (value) => value >= 0 && value < 1);
const fromZero = number("a number from 0", (value) => value >= 0);
const oneOf = (...names: string[]): Rule => (value, key) => {
  if (!names.includes(value as string)) {
    throw new FieldError(`The metadata's ${key} is ${JSON.stringify(value)}; this viewer knows ${names.join(", ")}.`, REMEDY.newer);
  }
};
const boolean: Rule = (value, key) => {
  if (typeof value !== "boolean") fail(key, "true or false");
};
const text: Rule = (value, key) => {
  if (typeof value !== "string") fail(key, "a text");
};
const nullable = (rule: Rule): Rule => (value, key) => {
  if (value !== null) rule(value, key);
};
/** Of a key that may be missing. */
const optional = (rule: Rule): Rule => Object.assign((value: unknown, key: string) => rule(value, key), { optional: true as const });
const list = (least: number, most: number, rule: Rule): Rule => (value, key) => {
  if (!Array.isArray(value) || value.length < least || value.length > most) fail(key, `a list of ${least} to ${most}`);
  value.forEach((item, i) => rule(item, `${key}[${i}]`));
};
/** Unknown and missing keys are errors, but for those of optional values. */
const record = (rules: Record<string, Rule>): Rule => (value, key) => {
  if (typeof value !== "object" || value === null || Array.isArray(value)) fail(key, "an object");
  const found = value as Record<string, unknown>;
  for (const name of Object.keys(found)) {
    if (!Object.hasOwn(rules, name)) throw new FieldError(`The metadata's ${join(key, name)} is not known.`, REMEDY.newer);
  }
  for (const [name, rule] of Object.entries(rules)) {
    if (!Object.hasOwn(found, name) && rule.optional) continue;
    if (!Object.hasOwn(found, name)) fail(join(key, name), "there");
    rule(found[name], join(key, name));
  }
};
const join = (key: string, name: string) => (key ? `${key}.${name}` : name);

const triple = list(3, 3, finite);
const encoding = record({
  number: oneOf("u8", "u16", "f16", "f32"),
  bits: whole(1, 32),
  center: finite,
  step: finite,
  curve: finite,
  empty: finite,
  empty_code: boolean,
  decode: oneOf(...DECODES),
  max_error: fromZero,
});

const network = record({
  frequencies: whole(0, 32),
  input: oneOf("diffuse_and_features", "features"),
  widths: list(2, 32, whole(1, 4096)),
});
const harmonics = record({
  kind: oneOf("spherical_harmonics"),
  degree: whole(0, 3),
  where: oneOf("ray", "sample"),
  offset: finite,
  clamp: oneOf("zero", "none", "sigmoid"),
});
const isHarmonics = (value: unknown) => typeof value === "object" && value !== null && "kind" in value;

const METADATA = record({
  bounds: record({ min: triple, max: triple }),
  activation: record({
    interval: positive,
    order: oneOf("raw", "density", "opacity"),
    shift: finite,
    function: optional(oneOf("relu")),
  }),
  march: record({
    alpha_threshold: share,
    color_threshold: share,
    far: nullable(finite),
    near: fromZero,
    sampled: optional(record({ min: triple, max: triple })),
    stepsize: positive,
    voxel: optional(list(3, 3, positive)),
    voxel_size: positive,
  }),
  step_rule: oneOf("constant", "level_of_detail"),
  level_of_detail: record({
    aside: oneOf("same_distance", "same_index"),
    bias: finite,
    factor: positive,
    most: nullable(fromZero),
    bends: optional(list(1, 6, list(2, 2, finite))),
  }),
  blend: oneOf("before_activation", "after_activation"),
  background: triple,
  color_space: oneOf("srgb_display"),
  features: whole(0, 61),
  view: nullable((value, key) => (isHarmonics(value) ? harmonics : network)(value, key)),
  free_space: boolean,
  alpha_threshold: share,
  filter: text,
  levels: list(
    1,
    32,
    record({
      dimensions: list(3, 3, whole(2, 65536)),
      block_size: whole(1, 64),
      blocks_stored: whole(0, 2 ** 33),
      blocks_filled: optional(whole(1, 2 ** 33)),
      density: nullable(encoding),
      diffuse: encoding,
      features: nullable(encoding),
      bands: optional(list(1, 3, encoding)),
      directional: optional(encoding),
      anisotropy: optional(encoding),
    }),
  ),
});

/** Blocks along each axis of a level. */
export function blockCounts(level: LevelMetadata): Triple {
  return level.dimensions.map((nodes) => Math.ceil(nodes / level.block_size)) as Triple;
}

/** The network's shape, where colour depends on the view by one. */
export function networkOf({ view }: Metadata): NetworkShape | null {
  return view && !("kind" in view) ? view : null;
}

/** The rules of harmonics, where colours are their coefficients. */
export function harmonicsOf({ view }: Metadata): Harmonics | null {
  return view && "kind" in view ? view : null;
}

/** Inputs of the network that follow the embedded direction. */
export function networkInputs(metadata: Metadata): number {
  return networkOf(metadata)?.input === "features" ? metadata.features : 3 + metadata.features;
}

/** The groups of a level's values beside density, in the order of their channels. */
export function valueGroups(metadata: Metadata, level: number): { kind: string; encoding: Encoding; channels: number; key: string }[] {
  const { diffuse, features, bands, directional, anisotropy } = metadata.levels[level];
  const groups = [{ kind: "DIFF", encoding: diffuse, channels: 3, key: "diffuse" }];
  if (features) groups.push({ kind: "FEAT", encoding: features, channels: metadata.features, key: "features" });
  bands?.forEach((encoding, i) => groups.push({ kind: ["BNDA", "BNDB", "BNDC"][i], encoding, channels: 3 * (2 * i + 3), key: `bands[${i}]` }));
  if (directional) groups.push({ kind: "DIRB", encoding: directional, channels: DIRECTIONAL, key: "directional" });
  if (anisotropy) groups.push({ kind: "ANIS", encoding: anisotropy, channels: ANISOTROPY, key: "anisotropy" });
  return groups;
}

/** Values of a node's directional brightness. */
export const DIRECTIONAL = 3;
/** Values of a node's anisotropy. */
export const ANISOTROPY = 5;
/** Colour channels and features of a node, its directional brightness among them, at most. */
const MOST_CHANNELS = 64;

/** The finest level with directional brightness or anisotropy; null where there is none. */
export function finestDirectional({ levels }: Metadata): number | null {
  const level = levels.findIndex(({ directional, anisotropy }) => directional ?? anisotropy);
  return level < 0 ? null : level;
}

/** Whether a level has values of this kind. */
export function hasLevels({ levels }: Metadata, kind: "directional" | "anisotropy"): boolean {
  return levels.some((level) => level[kind] !== undefined);
}

/** Channels of colour and features that every level has. */
export function ownChannels(metadata: Metadata): number {
  return 3 + metadata.features;
}

/** Quadruples of channels of colour and features that the device holds for a node. */
export function channelQuads(metadata: Metadata): number {
  return Math.ceil(ownChannels(metadata) / 4);
}

/** Whether the file requires the feature "linear values": linear colours, coefficients, relu, or samples placed by a box or voxel of their own. */
export function needsLinearValues(metadata: Metadata): boolean {
  const { activation, march, levels } = metadata;
  const placed = march.sampled !== undefined || march.voxel !== undefined;
  return placed || harmonicsOf(metadata) !== null || activation.function !== undefined || levels[0].diffuse.decode === "linear";
}

/** Reads chunk META. */
export function readMetadata(bytes: Uint8Array): Metadata {
  let parsed: unknown;
  try {
    parsed = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch {
    throw new FieldError("The metadata is no JSON in UTF-8.");
  }
  METADATA(parsed, "");
  const metadata = parsed as Metadata;
  checkAgreement(metadata);
  return metadata;
}

/** Samples of a ray, at most; far below the whole numbers that the shader's floats count to. */
const MOST_SAMPLES = 2 ** 20;
/** Blocks of a level, at most, as in the program: its table is inflated before anything of it can be held to the file. */
const MOST_BLOCKS = 2 ** 26;

function checkAgreement(metadata: Metadata): void {
  const { bounds, march, levels, activation } = metadata;
  const [view, harmonics] = [networkOf(metadata), harmonicsOf(metadata)];
  if (!bounds.min.every((min, axis) => min < bounds.max[axis])) fail("bounds", "a box, min below max");
  const samples = Math.floor(Math.hypot(...levels[0].dimensions.map((nodes) => nodes + 1)) / march.stepsize);
  if (samples > MOST_SAMPLES) fail("march.stepsize", `steps of which a ray takes at most ${MOST_SAMPLES}`);
  const { min, max } = march.sampled ?? bounds;
  const within = min.every((low, axis) => bounds.min[axis] <= low && low < max[axis] && max[axis] <= bounds.max[axis]);
  if (!within) fail("march.sampled", "a box within bounds");
  if (march.far !== null && march.far <= march.near) fail("march.far", "above near");
  levels.forEach((level, i) => {
    const key = `levels[${i}]`;
    if (i > 0 && !level.dimensions.every((nodes, axis) => nodes <= levels[i - 1].dimensions[axis])) {
      fail(`${key}.dimensions`, "no more than those of the finer level");
    }
    const [x, y, z] = level.dimensions;
    if (x * y * z > 2 ** 33) fail(`${key}.dimensions`, "2^33 nodes at most");
    const [bx, by, bz] = blockCounts(level);
    const blocks = bx * by * bz;
    if (blocks > MOST_BLOCKS) throw new FieldError(`The metadata's ${key} has ${blocks} blocks; a level may have ${MOST_BLOCKS} at most.`);
    if (level.blocks_stored > blocks) fail(`${key}.blocks_stored`, "no more than the level has");
    const inheriting = [i, i + 1].filter((number) => number < levels.length);
    const colors = inheriting.flatMap((number) => valueGroups(metadata, number)).filter(({ kind }) => kind !== "ANIS");
    const integers = inheriting.length === 2 && colors.every(({ encoding: { number } }) => number === "u8" || number === "u16");
    if ((level.blocks_filled ?? 0) > (integers ? level.blocks_stored : 0)) {
      fail(`${key}.blocks_filled`, "no more than are stored, of a level with a coarser one, both with colours in integers");
    }
    if ((level.features !== null) !== (metadata.features > 0 && !harmonics)) fail(`${key}.features`, "there if the field has features");
    if ((level.bands?.length ?? 0) !== (harmonics?.degree ?? 0)) fail(`${key}.bands`, "one for each band of harmonics");
    const densities = metadata.blend === "after_activation" ? ["raw_density", "sqrt_optical_depth", "opacity"] : ["raw_density"];
    if (level.density) checkEncoding(level.density, `${key}.density`, densities);
    const coarser = levels[i + 1];
    if (level.directional && coarser && !coarser.directional) fail(`${key}.directional`, "left out where the next coarser level has none");
    if (level.directional && (metadata.blend !== "after_activation" || ownChannels(metadata) + DIRECTIONAL > MOST_CHANNELS)) {
      fail(`${key}.directional`, "left out but for levels that are blended after activation, with 58 features at most");
    }
    if (level.anisotropy && (level.density?.decode !== "sqrt_optical_depth" || level.anisotropy.empty !== 0)) {
      fail(`${key}.anisotropy`, "left out but for densities that decode as sqrt_optical_depth, with an empty value of 0");
    }
    const plain = !metadata.view && levels[0].diffuse.decode === "linear" ? "linear" : "logit";
    for (const { encoding, key: group, kind } of valueGroups(metadata, i)) {
      // Added to logits alone.
      const added = !harmonics && plain === "logit" ? "directional_logit" : "none";
      const ofDensity = kind === "ANIS" ? "directional_sqrt_depth" : null;
      const decode = ofDensity ?? (kind === "DIRB" ? added : harmonics ? `band_${["DIFF", "BNDA", "BNDB", "BNDC"].indexOf(kind)}` : plain);
      checkEncoding(encoding, `${key}.${group}`, [decode]);
    }
  });
  if (levels[0].density === null) fail("levels[0].density", "an encoding");
  if (metadata.blend === "after_activation" && levels.some((level) => level.density === null)) {
    fail("blend", "before_activation where a level has no density");
  }
  let { factor: slope, bends = [] } = metadata.level_of_detail;
  bends.forEach(([at, by], i) => {
    slope += by;
    if (slope <= 0 || (i > 0 && at <= bends[i - 1][0])) fail("level_of_detail.bends", "in rising order, with slopes above 0");
  });
  if (activation.function && activation.shift !== 0) fail("activation.shift", "0 beside relu");
  if (harmonics && metadata.features !== 3 * ((harmonics.degree + 1) ** 2 - 1)) fail("features", "those of the degree of harmonics");
  if (harmonics?.clamp === "sigmoid" && harmonics.where === "ray") fail("view.clamp", "a sigmoid at samples only");
  if (view && (view.widths[0] !== 3 + 6 * view.frequencies + networkInputs(metadata) || view.widths.at(-1) !== 3)) {
    fail("view.widths", "those of its inputs and of three colours");
  }
}

/** `decodes` are the meanings that the group may have. */
function checkEncoding(stored: Encoding, key: string, decodes: string[]): void {
  const { number: type, bits, decode, center, step, curve } = stored;
  const [least, most] = { u8: [1, 8], u16: [9, 16], f16: [16, 16], f32: [32, 32] }[type];
  if (bits < least || bits > most) fail(`${key}.bits`, `${least} to ${most}`);
  if (!decodes.includes(decode)) fail(`${key}.decode`, "one that fits its group");
  if (!type.startsWith("f")) return;
  if (stored.empty_code) fail(`${key}.empty_code`, "false for floats");
  if (center !== 0 || step !== 0 || curve !== 0) fail(key, "one whose center, step and curve are 0, as of all floats");
}
