/** Viewpoints: as text for an address, and from camera files. */

import { Matrix4, Vector3 } from "three";
import { FieldError, REMEDY } from "../errors.js";

/** Positions in world units. `fov` is in degrees along the picture's shorter side; null keeps the current one. */
export interface Viewpoint {
  position: Vector3;
  target: Vector3;
  fov: number | null;
}

/** A viewpoint of a camera file. */
export interface Preset {
  name: string;
  /** The camera's transform in the field's axes. */
  toField: Matrix4;
  fov: number | null;
}

/** Range of sensible fields of view, in degrees. */
export const FOVS = { least: 10, most: 120 } as const;

/** Seven numbers with commas: position, target, field of view. */
export function viewpointText({ position, target, fov }: Viewpoint): string {
  return [...position.toArray(), ...target.toArray(), ...(fov === null ? [] : [fov])].map((value) => Number(value.toPrecision(6))).join();
}

/** Parses a viewpoint; null if the text is not one. */
export function readViewpoint(text: string): Viewpoint | null {
  const values = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  if (![6, 7].includes(values.length) || !values.every(Number.isFinite)) return null;
  const [position, target] = [new Vector3(...values.slice(0, 3)), new Vector3(...values.slice(3, 6))];
  if (position.distanceTo(target) === 0) return null;
  const fov = values.length === 7 ? Math.min(FOVS.most, Math.max(FOVS.least, values[6])) : null;
  return { position, target, fov };
}

/**
 * Reads the cameras of a file in NeRF-synthetic format: `camera_angle_x`, and the `transform_matrix` of each of its
 * `frames`.
 */
export function readPresets(text: string, file: string): Preset[] {
  const no = (what: string) => new FieldError(`${file} is no camera file: ${what}.`, REMEDY.foreign);
  let content: unknown;
  try {
    content = JSON.parse(text);
  } catch {
    throw no("it is no JSON");
  }
  const { frames, camera_angle_x: angle } = (content ?? {}) as { frames?: unknown; camera_angle_x?: unknown };
  if (!Array.isArray(frames) || frames.length === 0) throw no("it has no list frames");
  const degrees = typeof angle === "number" && angle > 0 && angle < Math.PI ? (angle * 180) / Math.PI : null;
  return frames.map((frame, number) => {
    const { transform_matrix: rows, file_path: path } = (frame ?? {}) as { transform_matrix?: unknown; file_path?: unknown };
    const values = (Array.isArray(rows) ? rows : []).flat();
    if (![12, 16].includes(values.length) || !values.every(Number.isFinite)) throw no(`frame ${number} has no transform_matrix of 4 by 4 numbers`);
    const name = typeof path === "string" ? (path.split("/").pop() ?? path) : `Camera ${number}`;
    return { name, toField: new Matrix4().fromArray([...values, 0, 0, 0, 1].slice(0, 16)).transpose(), fov: degrees };
  });
}

/**
 * The viewpoint of a preset in the world of a field at `world`. Its target is the point of its axis nearest to
 * `center`, at least `least` away.
 */
export function presetViewpoint({ toField, fov }: Preset, world: Matrix4, center: Vector3, least = 1e-6): Viewpoint {
  const toWorld = new Matrix4().multiplyMatrices(world, toField);
  const position = new Vector3().setFromMatrixPosition(toWorld);
  const forward = new Vector3().setFromMatrixColumn(toWorld, 2).normalize().negate();
  const reach = Math.max(forward.dot(center.clone().sub(position)), 0.1 * position.distanceTo(center), least);
  return { position, target: position.clone().addScaledVector(forward, reach), fov };
}
