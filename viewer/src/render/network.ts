/** The view-dependent network as GLSL, and its weights as uniforms, or as a texture where they are many. */

import type { Layer } from "../format/network.js";
import { type NetworkShape, networkOf, ownChannels } from "../format/metadata.js";
import { boxesOf, isNested, partsOf } from "../format/parts.js";
import type { Opened } from "../load/loader.js";

/** Widest layer of a network that a fragment can hold. */
export const WIDEST_LAYER = 256;
/** Texels along a row of the texture of weights: a power of two. */
export const WEIGHTS_WIDTH = 1024;

/** Uniforms of four numbers that the shader has besides weights: for each level or shell, for each of several boxes, and for all of them. */
const [UNIFORMS_OF_PART, UNIFORMS_OF_BOX, OTHER_UNIFORMS] = [4, 4, 64];

/**
 * Whether the weights are uniforms. Those cost graphics cards next to nothing, as all pixels read the same ones
 * at the same time; texels of 32-bit floats are the dearest that there are.
 */
export function weighsByUniforms({ metadata, plan, network }: Opened): boolean {
  const others = UNIFORMS_OF_PART * partsOf(metadata).length + (isNested(metadata) ? UNIFORMS_OF_BOX * boxesOf(metadata).length : 0) + OTHER_UNIFORMS;
  return network.length > 0 && packedLength(network) + others <= plan.uniforms;
}

/** Quadruples of packed weights. */
function packedLength(network: Layer[]): number {
  return network.reduce((sum, { inputs, outputs }) => sum + quads(outputs) * (1 + 4 * quads(inputs)), 0);
}

function quads(values: number): number {
  return Math.ceil(values / 4);
}

/** The first layer's inputs as GLSL: the direction, its sines, its cosines, and what the ray has gathered. */
function inputQuads(view: NetworkShape, { metadata }: Opened): string[] {
  const axes = ["x", "y", "z"].map((axis) => `d.${axis}`);
  const angles = axes.flatMap((axis) => Array.from({ length: view.frequencies }, (_, k) => `${axis} * ${2 ** k}.0`));
  const gathered = Array.from({ length: ownChannels(metadata) }, (_, i) => `accumulated[${i >> 2}].${"xyzw"[i % 4]}`);
  const turned = ["sin", "cos"].flatMap((name) => angles.map((angle) => `${name}(${angle})`));
  const values = [...axes, ...turned, ...gathered.slice(view.input === "features" ? 3 : 0)];
  while (values.length % 4 > 0) values.push("0.0");
  return Array.from({ length: values.length / 4 }, (_, i) => `vec4(${values.slice(4 * i, 4 * i + 4).join(", ")})`);
}

/** The view-dependent colour as GLSL, four inputs at a time. */
export function networkSource(opened: Opened): string {
  const { metadata, network } = opened;
  const view = networkOf(metadata);
  if (!view || network.length === 0) return "";
  const lines = [
    ...(weighsByUniforms(opened)
      ? [`uniform vec4 u_network[${packedLength(network)}];`, "vec4 weight(int at) { return u_network[at]; }"]
      : // Processors divide whole numbers one by one.
        [`vec4 weight(int at) { return texelFetch(u_weights, ivec2(at & ${WEIGHTS_WIDTH - 1}, at >> ${Math.log2(WEIGHTS_WIDTH)}), 0); }`]),
    "vec3 networkColor(vec3 d, vec4 accumulated[QUADS]) {",
    "  int at = 0;",
    "  vec4 x;",
  ];
  /** Adds to all outputs of a layer what `x` gives them. */
  const spread = (layer: number) => {
    const sum = "vec4(dot(weight(at), x), dot(weight(at + 1), x), dot(weight(at + 2), x), dot(weight(at + 3), x))";
    return `for (int o = 0; o < ${quads(network[layer].outputs)}; o++, at += 4) v${layer}[o] += ${sum};`;
  };
  network.forEach(({ inputs, outputs }, layer) => {
    const [to, isLast] = [quads(outputs), layer + 1 === network.length];
    lines.push(`  vec4 v${layer}[${to}];`, `  for (int o = 0; o < ${to}; o++) v${layer}[o] = weight(at++);`);
    if (layer > 0) lines.push(`  for (int i = 0; i < ${quads(inputs)}; i++) { x = v${layer - 1}[i]; ${spread(layer)} }`);
    // Inputs are made when they are needed, so that a ray holds few numbers at a time.
    else for (const x of inputQuads(view, opened)) lines.push(`  x = ${x};`, `  ${spread(0)}`);
    lines.push(`  for (int o = 0; o < ${to}; o++) v${layer}[o] = ${isLast ? `1.0 / (1.0 + exp(-v${layer}[o]))` : `max(v${layer}[o], vec4(0.0))`};`);
  });
  lines.push(`  return v${network.length - 1}[0].xyz;`, "}");
  return lines.join("\n");
}

/** Weights in the order in which the shader reads them: of each layer all biases, then for four inputs at a time the rows of all outputs. */
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
