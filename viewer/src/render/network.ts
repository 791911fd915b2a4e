/** The view-dependent network as a shader. Its weights are uniforms or, if there are many, a texture. */

import type { Layer } from "../format/network.js";
import { type Metadata, type NetworkShape, networkOf, ownChannels } from "../format/metadata.js";
import { boxesOf, isNested, partsOf } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import { encodedKinds } from "../load/texels.js";
import type { Language } from "./shader.js";

/** The widest network layer that a fragment can hold. */
export const WIDEST_LAYER = 256;
/** Texels per row of the texture of weights; a power of two. */
export const WEIGHTS_WIDTH = 1024;

/**
 * Four-component uniforms besides the weights: per level or shell besides its encodings, per box if there are several,
 * and for the whole field.
 */
const [UNIFORMS_OF_PART, UNIFORMS_OF_BOX, OTHER_UNIFORMS] = [4, 4, 64];

/** Maximum number of four-component uniforms in WebGPU: 64 KiB. */
const GPU_UNIFORMS = 4096;

/**
 * Whether the weights are uniforms. Uniforms are nearly free on GPUs, because all pixels read the same ones at the same
 * time; 32-bit float texels are the most expensive.
 */
export function weighsByUniforms({ metadata, plan, network }: Opened): boolean {
  const others = uniformsOfPart(metadata) * partsOf(metadata).length + (isNested(metadata) ? UNIFORMS_OF_BOX * boxesOf(metadata).length : 0) + OTHER_UNIFORMS;
  return network.length > 0 && packedLength(network) + others <= Math.min(plan.uniforms, GPU_UNIFORMS);
}

function uniformsOfPart(metadata: Metadata): number {
  return UNIFORMS_OF_PART + encodedKinds(metadata).length;
}

/** Number of quadruples of packed weights. */
function packedLength(network: Layer[]): number {
  return network.reduce((sum, { inputs, outputs }) => sum + quads(outputs) * (1 + 4 * quads(inputs)), 0);
}

function quads(values: number): number {
  return Math.ceil(values / 4);
}

/** The first layer's inputs: the direction, its sines, its cosines, and the values accumulated along the ray. */
function inputQuads(view: NetworkShape, { metadata }: Opened, { vec4, gathered }: Words): string[] {
  const axes = ["x", "y", "z"].map((axis) => `d.${axis}`);
  const angles = axes.flatMap((axis) => Array.from({ length: view.frequencies }, (_, k) => `${axis} * ${2 ** k}.0`));
  const own = Array.from({ length: ownChannels(metadata) }, (_, i) => `${gathered}[${i >> 2}].${"xyzw"[i % 4]}`);
  const turned = ["sin", "cos"].flatMap((name) => angles.map((angle) => `${name}(${angle})`));
  const values = [...axes, ...turned, ...own.slice(view.input === "features" ? 3 : 0)];
  while (values.length % 4 > 0) values.push("0.0");
  return Array.from({ length: values.length / 4 }, (_, i) => `${vec4}(${values.slice(4 * i, 4 * i + 4).join(", ")})`);
}

/** The differences between the languages. */
interface Words {
  vec4: string;
  /** The values accumulated along the ray. */
  gathered: string;
  int: string;
  /** Declares an array of quadruples; opens a function. */
  list(name: string, length: number): string;
  open(name: string, parameters: string, result: string): string;
  fetch: string;
}

/** Column and row of the texel of a weight index. CPUs divide integers one by one, so there is no division. */
const [COLUMN, ROW] = [`at & ${WEIGHTS_WIDTH - 1}`, `at >> ${Math.log2(WEIGHTS_WIDTH)}`];

const GLSL: Words = {
  vec4: "vec4",
  gathered: "accumulated",
  int: "int",
  list: (name, length) => `vec4 ${name}[${length}];`,
  open: (name, parameters, result) => `${result} ${name}(${parameters}) {`,
  fetch: `texelFetch(u_weights, ivec2(${COLUMN}, ${ROW}), 0)`,
};

const WGSL: Words = {
  vec4: "vec4f",
  gathered: "(*accumulated)",
  int: "var",
  list: (name, length) => `var ${name}: array<vec4f, ${length}>;`,
  open: (name, parameters, result) => `fn ${name}(${parameters}) -> ${result} {`,
  fetch: `textureLoad(u_weights, vec2i(${COLUMN}, ${ROW}u), 0)`,
};

/** The view-dependent colour, four inputs at a time. */
export function networkSource(opened: Opened, language: Language): string {
  const { metadata, network } = opened;
  const view = networkOf(metadata);
  if (!view || network.length === 0) return "";
  const isGlsl = language === "glsl";
  const words = isGlsl ? GLSL : WGSL;
  const { vec4, int, list, open, fetch } = words;
  const byUniforms = weighsByUniforms(opened);
  const uniform = isGlsl ? "u_network[at]" : "u_network(at)";
  const lines = [
    ...(byUniforms && isGlsl ? [`uniform vec4 u_network[${packedLength(network)}];`] : []),
    `${open("weight", isGlsl ? "int at" : "at: i32", vec4)} return ${byUniforms ? uniform : fetch}; }`,
    isGlsl ? open("networkColor", "vec3 d, vec4 accumulated[QUADS]", "vec3") : open("networkColor", "d: vec3f, accumulated: ptr<function, array<vec4f, QUADS>>", "vec3f"),
    `  ${int} at = 0;`,
    `  ${isGlsl ? "vec4 x" : "var x: vec4f"};`,
  ];
  const loop = (name: string, count: number, body: string) => `for (${int} ${name} = 0; ${name} < ${count}; ${name}++) { ${body} }`;
  /** Adds the contribution of `x` to all outputs of a layer. */
  const spread = (layer: number) => {
    const sum = `${vec4}(dot(weight(at), x), dot(weight(at + 1), x), dot(weight(at + 2), x), dot(weight(at + 3), x))`;
    return loop("o", quads(network[layer].outputs), `v${layer}[o] += ${sum}; at += 4;`);
  };
  network.forEach(({ inputs, outputs }, layer) => {
    const [to, isLast] = [quads(outputs), layer + 1 === network.length];
    lines.push(`  ${list(`v${layer}`, to)}`, `  ${loop("o", to, `v${layer}[o] = weight(at); at++;`)}`);
    if (layer > 0) lines.push(`  ${loop("i", quads(inputs), `x = v${layer - 1}[i]; ${spread(layer)}`)}`);
    // Inputs are made when they are needed, so that a ray holds few numbers at a time.
    else for (const x of inputQuads(view, opened, words)) lines.push(`  x = ${x};`, `  ${spread(0)}`);
    lines.push(`  ${loop("o", to, `v${layer}[o] = ${isLast ? `1.0 / (1.0 + exp(-v${layer}[o]))` : `max(v${layer}[o], ${vec4}(0.0))`};`)}`);
  });
  lines.push(`  return v${network.length - 1}[0].xyz;`, "}");
  return lines.join("\n");
}

/**
 * Weights in the order in which the shader reads them: for each layer all biases, then, for four inputs at a time, the
 * rows of all outputs.
 */
export function packWeights(network: Layer[]): number[] {
  const packed: number[] = [];
  for (const { inputs, outputs, weights, biases } of network) {
    const rows = Array.from({ length: 4 * quads(outputs) }, (_, row) => row);
    packed.push(...rows.map((row) => (row < outputs ? biases[row] : 0)));
    for (let i = 0; i < inputs; i += 4) {
      for (const row of rows) {
        for (let input = i; input < i + 4; input++) packed.push(row < outputs && input < inputs ? weights[row * inputs + input] : 0);
      }
    }
  }
  return packed;
}
