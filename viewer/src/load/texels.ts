/**
 * The contents of texels in a field's atlases: codes as in the file, if all parts have one-byte codes, else values.
 * Shaders decode codes at the eight corners of a cell and interpolate the values.
 */

import { valueTable } from "../format/codings/values.js";
import { type Encoding, harmonicsOf, hasLevels, type Metadata, ownChannels, storedGroups } from "../format/metadata.js";
import { partsOf } from "../format/parts.js";
import { interpolatedDensity, LARGEST_DENSITY } from "./interpolated.js";

/** The contents of a texel per channel: a one-byte code, or a value of 16 or 32 bits. */
export type Texel = "codes" | "halves" | "floats";
export const TEXEL_BYTES: Readonly<Record<Texel | "beside", number>> = { codes: 1, halves: 2, floats: 4, beside: 0 };

/**
 * The texels of each atlas: density, colours, and direction-dependent values. If density has the same texels as colours
 * and their last quadruple has a free channel, density is the last channel of the colour atlas.
 */
export interface Texels {
  density: Texel | "beside";
  color: Exclude<Texel, "floats">;
  directional: Exclude<Texel, "floats">;
}

/** Whether a chunk's values depend on the direction, so that they are in the third atlas. */
export function isDirectional(kind: string): boolean {
  return kind === "ANIS" || kind === "DIRB";
}

/** Number of codes in all levels and shells. */
export function storedCodes(metadata: Metadata): number {
  return partsOf(metadata).reduce((sum, { blocks_stored, block_size }, part) => {
    const channels = storedGroups(metadata, part).reduce((sum, { channels }) => sum + channels, 0);
    return sum + channels * blocks_stored * block_size ** 3;
  }, 0);
}

export function texelsOf(metadata: Metadata): Texels {
  const groups = partsOf(metadata).flatMap((_, part) => storedGroups(metadata, part));
  const areCodes = (own: typeof groups) => own.every(({ encoding }) => encoding.number === "u8");
  const densities = groups.filter(({ kind }) => kind === "DENS");
  const others = groups.filter(({ kind }) => kind !== "DENS");
  const density = densityTexel(metadata, densities.map(({ encoding }) => encoding));
  const color = areCodes(others.filter(({ kind }) => !isDirectional(kind))) ? "codes" : "halves";
  return {
    density: density === color && ownChannels(metadata) % 4 > 0 ? "beside" : density,
    color,
    directional: areCodes(others.filter(({ kind }) => isDirectional(kind))) ? "codes" : "halves",
  };
}

function densityTexel({ activation }: Metadata, encodings: Encoding[]): Texel {
  // What is interpolated may be no stored value, but what softplus makes of it.
  if (encodings.some(({ decode }) => decode === "raw_density" && activation.order !== "raw")) return "floats";
  if (encodings.some(({ number }) => number === "f32")) return "floats";
  if (encodings.some(({ number }) => number !== "u8")) return "halves";
  const isBounded = (encoding: Encoding) => valueTable(encoding, "DENS", interpolatedDensity(activation, encoding.decode))!.every((value) => Math.abs(value) < LARGEST_DENSITY);
  return encodings.every(isBounded) ? "codes" : "floats";
}

/** Groups of values by chunk kind, in the order in which shaders number their encodings. */
export function encodedKinds(metadata: Metadata): string[] {
  const bands = ["BNDA", "BNDB", "BNDC"].slice(0, harmonicsOf(metadata)?.degree ?? 0);
  const features = harmonicsOf(metadata) ? bands : metadata.features > 0 ? ["FEAT"] : [];
  return ["DENS", "DIFF", ...features, ...(hasLevels(metadata, "directional") ? ["DIRB"] : []), ...(hasLevels(metadata, "anisotropy") ? ["ANIS"] : [])];
}

/** The texels of a group of values. */
export function texelOf({ density, color, directional }: Texels, kind: string): Texel {
  if (kind === "DENS" && density !== "beside") return density;
  return isDirectional(kind) ? directional : color;
}

/** Textures return bytes as numbers from 0 to 1. */
const BYTE = 255;

/**
 * Parameters for decoding a texel `t` in the shader: the value of a code is `center + x * (step + curve * x * x)` with
 * `x = t - |middle|`, computed in that order. If `middle` is below 0, code 0 means empty. Values are their own
 * decoding.
 */
export function decoding(texel: Texel, encoding: Encoding | null): number[] {
  if (!encoding) return [0, 0, 0, 0];
  if (texel !== "codes") return [0, 1, 0, 0];
  const { center, step, curve, bits, empty_code } = encoding;
  return [center, step * BYTE, curve * BYTE ** 3, ((empty_code ? -1 : 1) * 2 ** (bits - 1)) / BYTE];
}
