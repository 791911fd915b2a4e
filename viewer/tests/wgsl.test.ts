/** What makes WGSL of a field: conditions, and where uniforms lie. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { unrolled } from "../src/render/shader.js";
import { applyConditions } from "../src/render/wgsl/conditions.js";
import { Data } from "../src/render/wgsl/data.js";

test("lines are kept by conditions, and names stand for values", () => {
  const source = ["a QUADS LEVELS_", "#if ORDER == 0 && defined(RELU)", "b", "#elif ORDER == 0", "c", "#elif ORDER == 1", "d", "#else", "e", "#endif", "#ifdef RELU", "#ifndef LINEAR", "f", "#endif", "#endif", "// QUADS", "#if defined(LINEAR) || !defined(RELU)", "g", "#endif"].join("\n");
  const lines = (defined: Record<string, string | number>) => applyConditions(source, defined).split("\n");
  assert.deepEqual(lines({ ORDER: 0, QUADS: 2, LEVELS: 3 }), ["a 2 LEVELS_", "c", "// QUADS", "g"]);
  assert.deepEqual(lines({ ORDER: 0, RELU: "", QUADS: 2 }), ["a 2 LEVELS_", "b", "f", "// QUADS"]);
  assert.deepEqual(lines({ ORDER: 1, RELU: "", LINEAR: "", QUADS: 7 }), ["a 7 LEVELS_", "d", "// QUADS", "g"]);
  assert.deepEqual(lines({ ORDER: 2, QUADS: 1 }), ["a 1 LEVELS_", "e", "// QUADS", "g"]);
  for (const wrong of ["#if A\n", "#ifdef A\nb", "#endif", "#else", "#define A 1", "#if A > 1\n#endif"]) assert.throws(() => applyConditions(wrong, { A: 1 }), /shader/);
});

test("uniforms lie one behind the other, in quadruples, and are read by their names", () => {
  const data = new Data({ u_slot: 3, u_skips: true, u_nodes: [1, 2, 3, 4, 5, 6, 7, 8], u_bends: [1, 2, 3, 4, 5, 6], u_toBox: [1, 2, 3, 4, 5, 6, 7, 8, 9] });
  assert.equal(data.length, 1 + 1 + 2 + 3 + 3);
  const numbers = new Float32Array(4 * data.length);
  data.write({ u_toBox: [1, 2, 3, 4, 5, 6, 7, 8, 9], u_bends: [1, 2, 3, 4, 5, 6], u_skips: true }, numbers);
  assert.deepEqual(Array.from(numbers), [0, 0, 0, 0, 1, 0, 0, 0, ...new Array(8).fill(0), 1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0, 1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0]);
  assert.deepEqual(data.source("list").split("\n"), [
    "fn u_slot() -> i32 { return i32(list[0].x); }",
    "fn u_skips() -> bool { return list[1].x != 0.0; }",
    "fn u_nodes(number: i32) -> vec4i { return vec4i(list[2 + number]); }",
    "fn u_bends(number: i32) -> vec2f { return list[4 + number].xy; }",
    "fn u_toBox() -> mat3x3f { return mat3x3f(list[7].xyz, list[8].xyz, list[9].xyz); }",
  ]);
  assert.throws(() => new Data({ u_unknown: 1 }), /u_unknown/);
});

test("what is done for each of few quadruples is written out, in both languages", () => {
  const source = (name: string) => [`  for (${name} quad = 0; quad < QUADS; quad++) { color[quad] = at(quad == 0, quads); }`, `for (${name} quad = low; quad < high; quad++) at(quad);`].join("\n");
  for (const name of ["int", "var"]) {
    assert.deepEqual(unrolled(source(name), 2).split("\n"), ["  { color[0] = at(0 == 0, quads); }", "  { color[1] = at(1 == 0, quads); }", source(name).split("\n")[1]]);
    assert.equal(unrolled(source(name), 7), source(name));
  }
  assert.equal(unrolled("for (int quad = 0; quad < QUADS; quad++) sum[quad] = vec4(0.0);", 1), "sum[0] = vec4(0.0);");
});
