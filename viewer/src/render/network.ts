/** The view-dependent network as GLSL, and its weights as uniforms, or as a texture where they are many. */

import type { Layer } from "../format/network.js";
import { networkOf } from "../format/metadata.js";
import type { Opened } from "../load/loader.js";

/** Widest layer of a network that a fragment can hold. */
export const WIDEST_LAYER = 256;
/** Texels along a row of the texture of weights: a power of two. */
export const WEIGHTS_WIDTH = 1024;

/** Uniforms of four numbers that the shader has besides weights: for each level, and for all of them. */
const [UNIFORMS_OF_LEVEL, OTHER_UNIFORMS] = [4, 64];

/**
 * Whether the weights are uniforms. Those cost graphics cards next to nothing, as all pixels read the same ones at the same time; texels of 32-bit
 * floats are the dearest that there are.
 */
export function weighsByUniforms({ metadata, plan, network }: Opened): boolean {
  return network.length > 0 && packedLength(network) + UNIFORMS_OF_LEVEL * metadata.levels.length + OTHER_UNIFORMS <= plan.uniforms;
}

/** Quadruples of packed weights. */
function packedLength(network: Layer[]): number {
  return network.reduce((sum, { inputs, outputs }) => sum + Math.ceil(outputs / 4) * (1 + 4 * Math.ceil(inputs / 4)), 0);
}

/** The view-dependent colour as GLSL, four inputs at a time. */
export function networkSource(opened: Opened): string {
  const { metadata, network } = opened;
  const view = networkOf(metadata);
  if (!view || network.length === 0) return "";
  const first = view.input === "features" ? 3 : 0;
  const lines = [
    ...(weighsByUniforms(opened)
      ? [`uniform vec4 u_network[${packedLength(network)}];`, "vec4 weight(int at) { return u_network[at]; }"]
      : // Processors divide whole numbers one by one.
        [`vec4 weight(int at) { return texelFetch(u_weights, ivec2(at & ${WEIGHTS_WIDTH - 1}, at >> ${Math.log2(WEIGHTS_WIDTH)}), 0); }`]),
    "vec3 networkColor(vec3 d, vec4 accumulated[QUADS]) {",
    `  float inputs[${4 * Math.ceil(network[0].inputs / 4)}];`,
    "  inputs[0] = d.x; inputs[1] = d.y; inputs[2] = d.z;",
    `  for (int axis = 0; axis < 3; axis++) for (int k = 0; k < ${view.frequencies}; k++) {`,
    "    float angle = d[axis] * exp2(float(k));",
    `    inputs[3 + axis * ${view.frequencies} + k] = sin(angle);`,
    `    inputs[3 + (3 + axis) * ${view.frequencies} + k] = cos(angle);`,
    "  }",
    `  for (int i = ${first}; i < CHANNELS; i++) inputs[${3 + 6 * view.frequencies - first} + i] = accumulated[i / 4][i % 4];`,
    `  for (int i = ${network[0].inputs}; i < inputs.length(); i++) inputs[i] = 0.0;`,
    `  vec4 v0[${Math.ceil(network[0].inputs / 4)}];`,
    "  for (int i = 0; i < v0.length(); i++) v0[i] = vec4(inputs[4 * i], inputs[4 * i + 1], inputs[4 * i + 2], inputs[4 * i + 3]);",
    "  int at = 0;",
  ];
  network.forEach(({ inputs, outputs }, layer) => {
    const [from, to] = [Math.ceil(inputs / 4), Math.ceil(outputs / 4)];
    const activated = layer + 1 < network.length ? "max(sum, vec4(0.0))" : "1.0 / (1.0 + exp(-sum))";
    lines.push(
      `  vec4 v${layer + 1}[${to}];`,
      `  for (int o = 0; o < ${to}; o++) {`,
      "    vec4 sum = weight(at++);",
      `    for (int i = 0; i < ${from}; i++, at += 4) {`,
      `      vec4 x = v${layer}[i];`,
      "      sum += vec4(dot(weight(at), x), dot(weight(at + 1), x), dot(weight(at + 2), x), dot(weight(at + 3), x));",
      "    }",
      `    v${layer + 1}[o] = ${activated};`,
      "  }",
    );
  });
  lines.push(`  return v${network.length}[0].xyz;`, "}");
  return lines.join("\n");
}

/** Weights in the order in which the shader reads them: four biases, then four rows of four inputs at a time. */
export function packWeights(network: Layer[]): number[] {
  const packed: number[] = [];
  for (const { inputs, outputs, weights, biases } of network) {
    for (let o = 0; o < outputs; o += 4) {
      const rows = [o, o + 1, o + 2, o + 3];
      packed.push(...rows.map((row) => (row < outputs ? biases[row] : 0)));
      for (let i = 0; i < inputs; i += 4) {
        for (const row of rows) {
          for (let input = i; input < i + 4; input++) packed.push(row < outputs && input < inputs ? weights[row * inputs + input] : 0);
        }
      }
    }
  }
  return packed;
}
