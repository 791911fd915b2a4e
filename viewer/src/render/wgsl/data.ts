/** A field's uniforms as one list of quadruples, which WGSL reads by functions with their names. */

import type { Uniforms } from "../uniforms.js";

type Type = "f32" | "i32" | "bool" | "vec2f" | "vec3f" | "vec4f" | "vec3i" | "vec4i" | "mat3x3f" | "mat4x4f";

/** Types by name. Types with `[]` are arrays of any length, read by index. */
const TYPES: Record<string, Type | `${Type}[]`> = {
  u_slot: "i32", u_slotsDeep: "i32", u_nodes: "vec4i[]", u_levels: "vec4i[]", u_codes: "vec4f[]", u_empty: "vec4f[]", u_emptyBands: "vec3f[]", u_finest: "i32", u_fixedLevel: "f32",
  u_output: "i32", u_skips: "bool", u_halfPixel: "f32", u_viewport: "vec4f", u_lens: "vec4f", u_isParallel: "bool", u_origin: "vec3f", u_toBox: "mat3x3f",
  u_toLocal: "mat3x3f", u_toView: "mat3x3f", u_toClip: "mat4x4f", u_farEnd: "vec2f", u_depthOfT: "vec2f", u_farDepth: "f32", u_logarithm: "vec3f", u_linear: "bool",
  u_activation: "vec2f", u_range: "vec2f", u_thresholds: "vec2f", u_lowest: "vec3f", u_highest: "vec3f", u_step: "f32", u_perVoxel: "vec3f", u_interval: "f32",
  u_mostSteps: "f32", u_levelOfDetail: "vec3f", u_bends: "vec2f[]", u_macroCounts: "vec3i[]", u_macroScale: "vec3f[]", u_boxOrigin: "vec3f[]", u_boxScale: "vec3f[]",
  u_voxels: "vec3f", u_toMask: "mat3x3f", u_maskShift: "vec3f", u_maskNearest: "bool", u_maskThreshold: "f32", u_network: "vec4f[]",
};

/** Number of quadruples of a value, and of components in each. */
function shapeOf(type: Type): [number, number] {
  const [, columns, rows] = /^(?:mat(\d)x|vec)(\d)/.exec(type) ?? ["", "1", "1"];
  return [Number(columns ?? 1), Number(rows)];
}

/** The places of the uniforms in the list. */
export class Data {
  /** Number of quadruples. */
  readonly length: number;
  private readonly places: { name: string; type: Type; isList: boolean; at: number }[] = [];

  /** For the uniforms of a field and a view: `example` has all names, and lists of their final length. */
  constructor(example: Uniforms) {
    let at = 0;
    for (const [name, value] of Object.entries(example)) {
      const named = TYPES[name];
      if (!named) throw new Error(`${name} has no type`);
      const isList = named.endsWith("[]");
      const type = named.replace("[]", "") as Type;
      const [columns, rows] = shapeOf(type);
      this.places.push({ name, type, isList, at });
      at += isList ? (value as number[]).length / rows : columns;
    }
    this.length = at;
  }

  /** Writes values into the list. Other values in the list do not change. */
  write(values: Uniforms, into: Float32Array): void {
    for (const { name, type, at } of this.places) {
      const value = values[name];
      if (value === undefined) continue;
      const numbers = Array.isArray(value) ? value : [Number(value)];
      const [, rows] = shapeOf(type);
      for (let i = 0; i < numbers.length; i++) into[4 * (at + Math.floor(i / rows)) + (i % rows)] = numbers[i];
    }
  }

  /** Functions, named after the uniforms, that read them from `list`. Integers are below 2^24. */
  source(list: string): string {
    return this.places.map(({ name, type, isList, at }) => `fn ${name}(${isList ? "number: i32" : ""}) -> ${type} { return ${read(type, list, isList ? `${at} + number` : String(at))}; }`).join("\n");
  }
}

function read(type: Type, list: string, at: string): string {
  const [columns, rows] = shapeOf(type);
  const part = ["", ".x", ".xy", ".xyz", ""][rows];
  if (columns > 1) return `${type}(${Array.from({ length: columns }, (_, column) => `${list}[${Number(at) + column}]${part}`).join(", ")})`;
  const value = `${list}[${at}]${part}`;
  if (type === "bool") return `${value} != 0.0`;
  return type.includes("i") ? `${type}(${value})` : value;
}
