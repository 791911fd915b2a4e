/** The values interpolated between nodes, as in the reference renderer: section 6 of `formats/mipvog.md`. */

import type { Encoding, Metadata } from "../format/metadata.js";

/** Larger densities make no difference, and their differences would overflow. */
export const LARGEST_DENSITY = 1e30;
/** Largest invisible opacity over one interval. */
const UNSEEN_OPACITY = 1e-10;

/** Converts a stored density to the interpolated value. */
export function interpolatedDensity({ shift, interval, order, function: relu }: Metadata["activation"], decode: Encoding["decode"]): (stored: number) => number {
  const bounded = (value: number) => Math.max(-LARGEST_DENSITY, Math.min(LARGEST_DENSITY, value));
  if (decode !== "raw_density" || order === "raw") return bounded;
  const softplus = (x: number) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
  const density = (raw: number) => (relu ? Math.max(bounded(raw), 0) : softplus(bounded(raw) + shift));
  if (order === "density") return density;
  return (raw) => -Math.expm1(-density(raw) * interval);
}

/** The largest value for which a cell between such nodes is invisible. */
export function invisibleDensity(activation: Metadata["activation"], decode: Encoding["decode"]): number {
  if (decode === "sqrt_optical_depth") return Math.sqrt(UNSEEN_OPACITY);
  if (decode === "opacity") return UNSEEN_OPACITY;
  // The raw density of that opacity; so far below, softplus is an exponential.
  const raw = activation.function ? UNSEEN_OPACITY / activation.interval : Math.log(UNSEEN_OPACITY / activation.interval) - activation.shift;
  return interpolatedDensity(activation, decode)(raw);
}
