/** Moving through a scene instead of around it: W, A, S, D, Q and E move, dragging looks around. */

import { Euler, type PerspectiveCamera, Vector3 } from "three";

/** Direction of each key: right, up, back. */
const WAYS: Record<string, [number, number, number]> = { KeyW: [0, 0, -1], KeyS: [0, 0, 1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0] };
/** Angle in radians of a drag across the height of the canvas. */
const LOOK = 1.5;
/** Factor on the speed per step of the wheel. */
const FASTER = 1.1;

/** `walk` keeps the height; `fly` follows the viewing direction. */
export type Way = "fly" | "walk";

export class Walk {
  /** Null does not move the camera. */
  way: Way | null = null;
  /** Speed in world units per second. */
  speed = 1;
  private readonly held = new Set<string>();
  private drag: number | null = null;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLCanvasElement,
    private readonly moved: () => void,
    ended: AbortSignal,
  ) {
    const listen = <Kind extends keyof HTMLElementEventMap>(kind: Kind, take: (event: HTMLElementEventMap[Kind]) => void) =>
      canvas.addEventListener(kind, take, { signal: ended });
    listen("keydown", (event) => {
      if (!this.way || !(event.code in WAYS) || event.ctrlKey || event.metaKey || event.altKey) return;
      this.held.add(event.code);
      event.preventDefault();
    });
    listen("keyup", (event) => this.held.delete(event.code));
    listen("blur", () => this.held.clear());
    listen("pointerdown", (event) => {
      if (!this.way) return;
      this.drag = event.pointerId;
      canvas.setPointerCapture(event.pointerId);
    });
    listen("pointermove", (event) => {
      if (this.way && event.pointerId === this.drag) this.look(event.movementX, event.movementY);
    });
    const end = (event: PointerEvent) => event.pointerId === this.drag && (this.drag = null);
    listen("pointerup", end);
    listen("pointercancel", end);
    listen("wheel", (event) => {
      if (!this.way) return;
      this.speed *= FASTER ** -Math.sign(event.deltaY);
      event.preventDefault();
    });
  }

  /** Moves on for this many seconds. */
  step(seconds: number): void {
    if (!this.way || this.held.size === 0) return;
    const by = new Vector3();
    for (const key of this.held) by.add(new Vector3(...WAYS[key]));
    if (by.lengthSq() === 0) return;
    const up = by.y;
    by.setY(0).applyQuaternion(this.camera.quaternion);
    if (this.way === "walk") by.setY(0);
    by.normalize().add(new Vector3(0, up, 0));
    this.camera.position.addScaledVector(by, this.speed * seconds);
    this.moved();
  }

  private look(right: number, down: number): void {
    const angles = new Euler().setFromQuaternion(this.camera.quaternion, "YXZ");
    const turn = LOOK / this.canvas.clientHeight;
    angles.y += right * turn;
    angles.x = Math.min(1.55, Math.max(-1.55, angles.x + down * turn));
    angles.z = 0;
    this.camera.quaternion.setFromEuler(angles);
    this.moved();
  }
}
