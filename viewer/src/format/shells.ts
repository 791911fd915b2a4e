/** Rules for the boxes around that of level 0: section 6 of `formats/mipvog.md`, "Nested boxes". */

import type { Box, LevelMetadata, Metadata } from "./generated.js";
import { extentOf, outerBounds } from "./parts.js";
import { fail } from "./rules.js";

/**
 * Maximum number of samples of a ray in one box; far below the largest integer that is exact in the shader's floats.
 */
const MOST_SAMPLES = 2 ** 20;
/** Maximum number of steps of a ray through all boxes: the largest integer that is exact in the shader's floats. */
const MOST_STEPS = 2 ** 24;
/** Range of the node spacing of a box relative to that of the next smaller one. */
const [LEAST_APART, MOST_APART] = [1.5, 3];

export function isBox({ min, max }: Box): boolean {
  return min.every((low, axis) => low < max[axis]);
}

export function isWithin(inner: Box, outer: Box): boolean {
  return inner.min.every((low, axis) => outer.min[axis] <= low && inner.max[axis] <= outer.max[axis]);
}

/** Checks that shells are nested, each with about twice the node spacing of the previous one. */
export function checkShells(metadata: Metadata): void {
  const { bounds, levels, shells } = metadata;
  if (!shells) return;
  if (shells.length >= levels.length) fail("shells", "fewer than levels");
  if (metadata.blend !== "after_activation") fail("blend", "after_activation beside shells");
  const spacings = ({ dimensions }: LevelMetadata, box: Box) => extentOf(box).map((extent, axis) => extent / (dimensions[axis] - 1));
  let smaller = { box: bounds, spacings: spacings(levels[0], bounds) };
  shells.forEach((shell, i) => {
    const box = shell.bounds!;
    const own = { box, spacings: spacings(shell, box) };
    const isLarger = isWithin(smaller.box, box) && !isWithin(box, smaller.box);
    const isApart = own.spacings.every((spacing, axis) => {
      const ratio = spacing / smaller.spacings[axis];
      return ratio >= LEAST_APART && ratio <= MOST_APART;
    });
    if (!isBox(box) || !isLarger || !isApart) fail(`shells[${i}].bounds`, "a larger box around the next smaller one, with nodes 1.5 to 3 times as far apart");
    smaller = own;
  });
}

/** Upper bound on the index of the last sample of a ray. */
export function lastSample(metadata: Metadata): number {
  const { levels, march, shells } = metadata;
  if (!shells) return Math.floor(Math.hypot(...levels[0].dimensions.map((nodes) => nodes + 1)) / march.stepsize);
  const voxels = extentOf(outerBounds(metadata)).map((extent, axis) => extent / (march.voxel?.[axis] ?? march.voxel_size));
  return Math.floor(Math.hypot(...voxels) / march.stepsize) + 1;
}

export function checkSteps(metadata: Metadata): void {
  const most = metadata.shells ? MOST_STEPS : MOST_SAMPLES;
  if (!(lastSample(metadata) <= most)) fail("march.stepsize", `steps of which a ray takes at most ${most}`);
}
