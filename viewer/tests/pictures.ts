/** Comparison of pictures that both renderers of three.js made. */

import assert from "node:assert/strict";
import type { Picture } from "./others/webgpu.js";
import { psnr } from "./support.js";

/** Pictures of both renderers are the same, and their depths. */
export function same([webgl, webgpu]: Picture[][], what = ""): void {
  assert.equal(webgl.length, webgpu.length);
  webgl.forEach((picture, number) => {
    const likeness = psnr(picture.pixels, webgpu[number].pixels);
    assert.ok(likeness >= 60, `${what} ${number}: ${likeness} dB`);
    const off = Math.max(0, ...picture.depths.map((depth, at) => Math.abs(depth - webgpu[number].depths[at])));
    assert.ok(off <= 1e-4, `${what} ${number}: depths ${off} apart`);
  });
}

/** Pixels that show something. */
export const drawn = ({ pixels }: Picture) => pixels.filter((value, at) => at % 4 < 3 && value < 250).length;

/** Pixels of a green mesh. */
export const green = ({ pixels }: Picture) => pixels.filter((value, at) => at % 4 === 1 && value > 250 && pixels[at - 1] < 5).length;
