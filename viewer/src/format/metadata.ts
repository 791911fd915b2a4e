/** The metadata, chunk META: section 4 of `formats/mipvog.md`. */

import { FieldError } from "../errors.js";
import { type Encoding, type Feature, GROUPS, type Harmonics, type LevelMetadata, type Metadata, METADATA_RULE, type NetworkShape, type Triple } from "./generated.js";
import { inheritedFrom, levelOfPart, outerBounds, partsOf, partsOfLevel } from "./parts.js";
import { fail } from "./rules.js";
import { checkShells, checkSteps, isBox, isWithin } from "./shells.js";

export type { Encoding, Harmonics, LevelMetadata, Metadata, NetworkShape, Triple } from "./generated.js";

/** Number of blocks along each axis of a level. */
export function blockCounts(level: LevelMetadata): Triple {
  return level.dimensions.map((nodes) => Math.ceil(nodes / level.block_size)) as Triple;
}

/** The network's shape, if a network computes the view-dependent colour. */
export function networkOf({ view }: Metadata): NetworkShape | null {
  return view && !("kind" in view) ? view : null;
}

/** The rules of harmonics, if colours are coefficients. */
export function harmonicsOf({ view }: Metadata): Harmonics | null {
  return view && "kind" in view ? view : null;
}

/** Number of network inputs after the embedded direction. */
export function networkInputs(metadata: Metadata): number {
  return networkOf(metadata)?.input === "features" ? metadata.features : 3 + metadata.features;
}

/** A group of a level's values, with its encoding. */
export interface ValueGroup {
  kind: string;
  encoding: Encoding;
  channels: number;
  /** Key of the encoding in the level's metadata. */
  key: string;
  color: boolean;
}

/** The stored groups of a part, in the order of their channels: density first, if the part has its own. */
export function storedGroups(metadata: Metadata, part: number): ValueGroup[] {
  const stored = partsOf(metadata)[part];
  return GROUPS.flatMap((group) => {
    const { key, kind, color } = group;
    const item = "item" in group ? group.item : null;
    const value = stored[key] as Encoding | Encoding[] | null | undefined;
    const encoding = Array.isArray(value) ? value[item ?? 0] : value;
    if (!encoding) return [];
    const channels = typeof group.channels === "number" ? group.channels : metadata[group.channels];
    return [{ kind, encoding, channels, key: item === null ? key : `${key}[${item}]`, color }];
  });
}

/** As `storedGroups`, without density. */
export function valueGroups(metadata: Metadata, part: number): ValueGroup[] {
  return storedGroups(metadata, part).filter(({ key }) => key !== "density");
}

/** Whether chunks of this kind hold colours, which blocks can inherit. Other kinds hold density. */
export function isColor(kind: string): boolean {
  return GROUPS.some((group) => group.kind === kind && group.color);
}

const channelsOf = (name: string) => Number(GROUPS.find((group) => group.name === name)?.channels);
/** Number of values of a node's directional brightness. */
export const DIRECTIONAL = channelsOf("directional");
/** Number of values of a node's anisotropy. */
export const ANISOTROPY = channelsOf("anisotropy");
/** Maximum number of colour channels and features of a node, including directional brightness. */
const MOST_CHANNELS = 64;

/** Whether any level or shell has values of this kind. */
export function hasLevels(metadata: Metadata, kind: "directional" | "anisotropy"): boolean {
  return partsOf(metadata).some((part) => part[kind] !== undefined);
}

/** Number of colour channels and features that every level has. */
export function ownChannels(metadata: Metadata): number {
  return 3 + metadata.features;
}

/** Number of quadruples of colour channels and features per node on the device. */
export function channelQuads(metadata: Metadata): number {
  return Math.ceil(ownChannels(metadata) / 4);
}

/** The features that a reader of this metadata must support. */
export function requiredFeatures(metadata: Metadata): Set<Feature> {
  const { activation, march, levels, level_of_detail } = metadata;
  const placed = march.sampled !== undefined || march.voxel !== undefined;
  const asked: Record<Feature, boolean> = {
    inherited_blocks: partsOf(metadata).some((part) => part.blocks_filled),
    linear_values: placed || harmonicsOf(metadata) !== null || activation.function !== undefined || levels[0].diffuse.decode === "linear",
    bent_rule: level_of_detail.bends !== undefined,
    directional: hasLevels(metadata, "directional"),
    anisotropy: hasLevels(metadata, "anisotropy"),
    nested_boxes: metadata.shells !== undefined,
  };
  return new Set((Object.keys(asked) as Feature[]).filter((feature) => asked[feature]));
}

/** Reads chunk META. */
export function readMetadata(bytes: Uint8Array): Metadata {
  let parsed: unknown;
  try {
    parsed = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch {
    throw new FieldError("The metadata is no JSON in UTF-8.");
  }
  METADATA_RULE(parsed, "");
  const metadata = parsed as Metadata;
  checkAgreement(metadata);
  return metadata;
}

/**
 * Maximum number of blocks of a level, as in the program: its table is decompressed before it can be checked against
 * the file.
 */
const MOST_BLOCKS = 2 ** 26;

function checkAgreement(metadata: Metadata): void {
  const { bounds, march, levels, activation } = metadata;
  const parts = partsOf(metadata);
  const [view, harmonics] = [networkOf(metadata), harmonicsOf(metadata)];
  if (!isBox(bounds)) fail("bounds", "a box, min below max");
  parts.forEach((part, i) => {
    const isShell = i >= levels.length;
    if ((part.bounds !== undefined) !== isShell) fail(`${keyOf(metadata, i)}.bounds`, isShell ? "there" : "left out but for shells");
  });
  checkShells(metadata);
  checkSteps(metadata);
  const sampled = march.sampled ?? bounds;
  if (!isBox(sampled) || !isWithin(sampled, outerBounds(metadata))) fail("march.sampled", "a box within that of everything");
  if (march.far !== null && march.far <= march.near) fail("march.far", "above near");
  parts.forEach((level, i) => {
    const key = keyOf(metadata, i);
    // A shell may have any size; what is next coarser is of its size.
    const finer = i > 0 && i < levels.length ? parts[partsOfLevel(metadata, i - 1)[0]] : level;
    if (!level.dimensions.every((nodes, axis) => nodes <= finer.dimensions[axis])) {
      fail(`${key}.dimensions`, "no more than those of the finer level");
    }
    const [x, y, z] = level.dimensions;
    if (x * y * z > 2 ** 33) fail(`${key}.dimensions`, "2^33 nodes at most");
    const [bx, by, bz] = blockCounts(level);
    const blocks = bx * by * bz;
    if (blocks > MOST_BLOCKS) throw new FieldError(`The metadata's ${key} has ${blocks} blocks; a level may have ${MOST_BLOCKS} at most.`);
    if (level.blocks_stored > blocks) fail(`${key}.blocks_stored`, "no more than the level has");
    const from = inheritedFrom(metadata, i);
    const colors = [i, from ?? i].flatMap((number) => valueGroups(metadata, number)).filter(({ color }) => color);
    const integers = from !== null && colors.every(({ encoding: { number } }) => number === "u8" || number === "u16");
    if ((level.blocks_filled ?? 0) > (integers ? level.blocks_stored : 0)) {
      fail(`${key}.blocks_filled`, "no more than are stored, of a level with a coarser one of the same box, both with colours in integers");
    }
    if ((level.features !== null) !== (metadata.features > 0 && !harmonics)) fail(`${key}.features`, "there if the field has features");
    if ((level.bands?.length ?? 0) !== (harmonics?.degree ?? 0)) fail(`${key}.bands`, "one for each band of harmonics");
    const densities = metadata.blend === "after_activation" ? ["raw_density", "sqrt_optical_depth", "opacity"] : ["raw_density"];
    if (level.density) checkEncoding(level.density, `${key}.density`, densities);
    const coarser = levels[levelOfPart(metadata, i) + 1];
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
  if (metadata.blend === "after_activation" && parts.some((part) => part.density === null)) {
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

/** The key of a part. */
function keyOf({ levels }: Metadata, part: number): string {
  return part < levels.length ? `levels[${part}]` : `shells[${part - levels.length}]`;
}

/** Checks an encoding. `decodes` lists the decodings that the group allows. */
function checkEncoding(stored: Encoding, key: string, decodes: string[]): void {
  const { number: type, bits, decode, center, step, curve } = stored;
  const [least, most] = { u8: [1, 8], u16: [9, 16], f16: [16, 16], f32: [32, 32] }[type];
  if (bits < least || bits > most) fail(`${key}.bits`, `${least} to ${most}`);
  if (!decodes.includes(decode)) fail(`${key}.decode`, "one that fits its group");
  if (!type.startsWith("f")) return;
  if (stored.empty_code) fail(`${key}.empty_code`, "false for floats");
  if (center !== 0 || step !== 0 || curve !== 0) fail(key, "one whose center, step and curve are 0, as of all floats");
}
