/** The view-dependent network as GLSL, and its weights as a texture. */

import type { Layer } from "../format/network.js";
import { type Metadata, networkOf } from "../format/metadata.js";

/** Widest layer of a network that a fragment can hold. */
export const WIDEST_LAYER = 256;
/** Texels along a row of the texture of weights: a power of two. */
export const WEIGHTS_WIDTH = 1024;

/** The view-dependent colour as GLSL: weights come from a texture, four inputs a texel. */
export function networkSource(metadata: Metadata, network: Layer[]): string {
  const view = networkOf(metadata);
  if (!view || network.length === 0) return "";
  const first = view.input === "features" ? 3 : 0;
  const lines = [
    // Processors divide whole numbers one by one.
    `vec4 weight(int at) { return texelFetch(u_weights, ivec2(at & ${WEIGHTS_WIDTH - 1}, at >> ${Math.log2(WEIGHTS_WIDTH)}), 0); }`,
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
export function packWeights(network: Layer[]): Float32Array {
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
  const row = 4 * WEIGHTS_WIDTH;
  const padded = new Float32Array(Math.max(1, Math.ceil(packed.length / row)) * row);
  padded.set(packed);
  return padded;
}
