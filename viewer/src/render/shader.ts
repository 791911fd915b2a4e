/** Assembles the shaders from what a field fixes at compile time. `march.glsl` has the march itself. */

import type { Layer } from "../format/network.js";
import { type Encoding, harmonicsOf, hasLevels, type Metadata, storedGroups } from "../format/metadata.js";
import { boxesOf, isNested, partsOf } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import type { Plan } from "../load/plan.js";
import { BOXES_BESIDE, macroRoom } from "../load/skip.js";
import { encodedKinds, isDirectional, texelOf } from "../load/texels.js";
import field from "./field.glsl";
import march from "./march.glsl";
import nested from "./nested.glsl";
import { networkSource } from "./network.js";
import rays from "./rays.glsl";

/** The framework prepends the version line, as for the fragment shader. */
export const VERTEX = /* glsl */ `
precision highp float;
uniform mat4 u_toClip;
uniform vec2 u_farEnd;
in vec3 position;

void main() {
  gl_Position = u_toClip * vec4(position, 1.0);
  // What lies before the camera's far plane is seen, though the box's far sides are behind it.
  gl_Position.z = u_farEnd.y * min(u_farEnd.y * gl_Position.z, u_farEnd.y * u_farEnd.x * gl_Position.w);
}
`;

/** The output of the fragment shader, as `u_output`. */
export const OUTPUT = { color: 0, levels: 1, statistics: 2, distance: 3 } as const;

/** Colours of levels, from the finest to the coarsest: blue, green, yellow, orange, red. */
const TINTS: [number, number, number][] = [
  [0.2, 0.35, 1.0],
  [0.1, 0.8, 0.5],
  [0.95, 0.9, 0.2],
  [1.0, 0.55, 0.1],
  [0.9, 0.15, 0.2],
];

/** The colour of a level as mixed by the shader, each channel 0 to 1. */
export function levelTint(level: number, levels: number): number[] {
  const x = ((TINTS.length - 1) * level) / Math.max(levels - 1, 1);
  const low = Math.min(Math.floor(x), TINTS.length - 2);
  return TINTS[low].map((value, channel) => value + (TINTS[low + 1][channel] - value) * (x - low));
}

/** Decodings of density. */
const DECODES: Partial<Record<Encoding["decode"], number>> = { raw_density: 0, sqrt_optical_depth: 1, opacity: 2 };
const CLAMPS = { none: 0, zero: 1, sigmoid: 2 } as const;
const ORDERS = { raw: 0, density: 1, opacity: 2 } as const;

/** The shader's number for the decoding of a level's densities. */
export function decodeNumber(decode: Encoding["decode"]): number {
  return DECODES[decode] ?? 0;
}

/** A number in shader syntax. */
function floatText(value: number): string {
  const text = String(value);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** Shader languages. */
export type Language = "glsl" | "wgsl";
const VECTORS = { glsl: { vec3: "vec3", ivec2: "ivec2", list: (count: number) => `vec3[${count}]` }, wgsl: { vec3: "vec3f", ivec2: "vec2i", list: (count: number) => `array<vec3f, ${count}>` } };

/** The definitions that a field fixes at compile time. */
export function defines(metadata: Metadata, { quads, directionalQuads, isPartial, texels }: Plan, network: Layer[], language: Language): Record<string, string | number> {
  const { vec3, ivec2, list } = VECTORS[language];
  const harmonics = harmonicsOf(metadata);
  const kinds = encodedKinds(metadata);
  const isThere = (kind: "directional" | "anisotropy") => directionalQuads > 0 && hasLevels(metadata, kind);
  const coded = partsOf(metadata).flatMap((_, part) => storedGroups(metadata, part)).filter(({ kind }) => texelOf(texels, kind) === "codes");
  const colors = coded.filter(({ kind }) => kind !== "DENS");
  const decodes = new Set(partsOf(metadata).flatMap(({ density }) => (density ? [decodeNumber(density.decode)] : [])));
  const set = (name: string, holds: boolean) => (holds ? { [name]: "" } : {});
  return {
    LEVELS: metadata.levels.length,
    PARTS: partsOf(metadata).length,
    ...(isNested(metadata) && nestedDefines(metadata, ivec2)),
    QUADS: quads,
    ...set("PARTIAL", isPartial),
    STATISTICS: OUTPUT.statistics,
    DISTANCE: OUTPUT.distance,
    TINTS: `${list(TINTS.length)}(${TINTS.map((tint) => `${vec3}(${tint.map(floatText)})`)})`,
    LAST_TINT: TINTS.length - 1,
    LEVEL_COLORS: OUTPUT.levels,
    ORDER: ORDERS[metadata.activation.order],
    ...set("BLEND_AFTER", metadata.blend === "after_activation"),
    ...set("STEPS_BY_LEVEL", metadata.step_rule === "level_of_detail"),
    ...set("ASIDE_SAME_INDEX", metadata.level_of_detail.aside === "same_index"),
    ...(metadata.level_of_detail.bends && { BENDS: metadata.level_of_detail.bends.length }),
    ...set("SHARED_DENSITY", metadata.levels.some((level) => level.density === null)),
    ...set("MASKED", metadata.free_space),
    ...set("NETWORK", network.length > 0),
    ...set("RELU", metadata.activation.function === "relu"),
    ...set("LINEAR", metadata.levels[0].diffuse.decode === "linear"),
    GROUPS: kinds.length,
    LAST_COLOR: kinds.filter((kind) => !isDirectional(kind)).length - 1,
    ...set("BESIDE", texels.density === "beside"),
    ...set("EMPTY_DENSITY", coded.some(({ kind, encoding }) => kind === "DENS" && encoding.empty_code)),
    ...(decodes.size === 1 && { DECODE: [...decodes][0] }),
    ...set("DENSITY_CURVES", coded.some(({ kind, encoding }) => kind === "DENS" && encoding.curve !== 0)),
    ...set("CURVES", colors.some(({ encoding }) => encoding.curve !== 0)),
    ...set("EMPTY_CODES", colors.some(({ encoding }) => encoding.empty_code)),
    ...set("DIRECTIONAL", directionalQuads > 0),
    ...(isThere("directional") && { BRIGHTNESS: kinds.indexOf("DIRB") }),
    ...(isThere("anisotropy") && { ANISOTROPY: kinds.indexOf("ANIS") }),
    ...(harmonics && {
      FUNCTIONS: (harmonics.degree + 1) ** 2,
      OFFSET: floatText(harmonics.offset),
      CLAMP: CLAMPS[harmonics.clamp],
      ...set("CLAMP_SAMPLES", harmonics.where === "sample"),
    }),
  };
}

/** The definitions for nested boxes. */
function nestedDefines(metadata: Metadata, ivec2: string): Record<string, string | number> {
  return { NESTED: "", BOXES: boxesOf(metadata).length, BOXES_BESIDE, MACRO_ROOM: `${ivec2}(${macroRoom(metadata).slice(1).join()})` };
}

/** The whole shader without its version line, including the field's network. */
export function fragmentShader(opened: Opened): string {
  const { metadata, plan, network } = opened;
  const fixed = Object.entries(defines(metadata, plan, network, "glsl")).map(([name, value]) => `#define ${name} ${value}`);
  return unrolled([...fixed, field, networkSource(opened, "glsl"), ...(isNested(metadata) ? [nested] : []), rays, march].join("\n"), plan.quads);
}

/** Up to this many quadruples, loops over quadruples are unrolled, because dynamic indexing is slow on CPUs. */
const UNROLLED = 4;

/** Unrolls the lines that repeat for each quadruple, if there are few quadruples. */
export function unrolled(source: string, quads: number): string {
  if (quads > UNROLLED) return source;
  return source.replace(/^( *)for \(\w+ quad = 0; quad < QUADS; quad\+\+\) (.*;|\{.*; \})$/gm, (_, indent, body) => Array.from({ length: quads }, (_, quad) => indent + body.replace(/\bquad\b/g, String(quad))).join("\n"));
}
