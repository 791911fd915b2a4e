/** Where a camera stands and may move in a world, which is viewed from inside. */

import { Box3, type PerspectiveCamera, type Scene, Vector3, type WebGLRenderer } from "three";
import type { RadianceField } from "../three/field.js";

/** Distance of the orbit target as a share of the innermost box, if nothing else is known. */
const REACH = 0.25;

export class Room {
  /** Half the diagonal of the innermost box. */
  readonly radius: number;
  /** The target of a camera at the standpoint: on the horizon, above the centre of the box. */
  readonly target: Vector3;
  /** The innermost box, and as much space around it. */
  private readonly walls: Box3;

  constructor(
    box: Box3,
    readonly standpoint: Vector3,
  ) {
    const size = box.getSize(new Vector3());
    this.radius = Math.max(size.length() / 2, 1e-6);
    this.walls = box.clone().expandByVector(size);
    const ahead = box.getCenter(new Vector3()).sub(standpoint).setY(0);
    if (ahead.length() < this.radius / 20) ahead.set(-1, 0, 0);
    this.target = standpoint.clone().addScaledVector(ahead.normalize(), REACH * Math.min(size.x, size.y, size.z));
  }

  /** Moves a camera that has left back to the walls, together with its target. Returns whether it had left. */
  keep(position: Vector3, target: Vector3): boolean {
    if (this.walls.containsPoint(position)) return false;
    const back = this.walls.clampPoint(position, new Vector3()).sub(position);
    position.add(back);
    target.add(back);
    return true;
  }
}

/** The distance of the surface in the middle of a camera's picture; null if there is none. */
export function distanceSeen(scene: Scene, renderer: WebGLRenderer, camera: PerspectiveCamera): number | null {
  camera.updateMatrixWorld();
  let reach: number | null = null;
  scene.traverse((part) => {
    if (reach !== null || !("isRadianceField" in part)) return;
    reach = (part as RadianceField).pick(renderer, camera, 0.5, 0.5)?.distanceTo(camera.position) ?? null;
  });
  return reach;
}
