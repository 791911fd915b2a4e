/** The work of a picture and the position shown at a point, from values that the shader writes instead of colours. */

import { isParallel, lensOf, type Matrix } from "./matrices.js";

/** The work of a picture, as means over the rays that meet the box. */
export interface Statistics {
  /** Number of rays that meet the box. */
  rays: number;
  samplesPerRay: number;
  fetchesPerRay: number;
  /** Samples between entry and exit, visited or skipped. */
  stepsPerRay: number;
}

/** Pixels along each side of the picture that a picked pixel belongs to, and the opacity that it must have. */
const [PICKED, LEAST_PICKED] = [1024, 0.1];

/** Statistics from pixels of `OUTPUT.statistics`, four numbers each; 0 where nothing was drawn. */
export function statisticsOf(pixels: Float32Array): Statistics {
  const sums = [0, 0, 0, 0];
  for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] === 1) for (let j = 0; j < 4; j++) sums[j] += pixels[i + j];
  const [samples, fetches, steps, rays] = sums;
  const mean = (sum: number) => sum / Math.max(rays, 1);
  return { rays, samplesPerRay: mean(samples), fetchesPerRay: mean(fetches), stepsPerRay: mean(steps) };
}

/** A projection onto one small pixel at `x`, `y`, fractions of the picture's width and height from the top left. */
export function pickedProjection(projection: Matrix, x: number, y: number): number[] {
  const middle = [2 * x - 1, 1 - 2 * y];
  return Array.from(projection, (value, at) => (at % 4 < 2 ? PICKED * (value - middle[at % 4] * projection[at - (at % 4) + 3]) : value));
}

/** A projection onto the pixel around a ray. Near and far do not affect its distance. */
export const RAY_PROJECTION: readonly number[] = pickedProjection([100, 0, 0, 0, 0, 100, 0, 0, 0, 0, -1, -1, 0, 0, -1e-4, 0], 0.5, 0.5);

/**
 * The world position at the centre of a picture from `camera`, from one pixel of `OUTPUT.distance`. Null if the field
 * is nearly transparent there.
 */
export function pickedPoint([distance, opacity]: Float32Array, camera: Matrix, projection: Matrix): [number, number, number] | null {
  if (!(opacity > LEAST_PICKED)) return null;
  const [, , right, up] = lensOf(projection);
  const reach = isParallel(projection) ? 1 : distance;
  const [x, y, z] = [right * reach, up * reach, -distance];
  const along = (axis: number) => camera[axis] * x + camera[axis + 4] * y + camera[axis + 8] * z + camera[axis + 12];
  return [along(0), along(1), along(2)];
}
