/** The canvas: camera, controls, and drawing on changes. */

import { Box3, type Color, type Object3D, PerspectiveCamera, Scene, Spherical, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { FieldError, REMEDY } from "../errors.js";
import { whenDone } from "../render/fence.js";
import type { Statistics } from "../render/measures.js";
import type { RadianceField } from "../three/field.js";
import { Painter } from "./painter.js";
import { captured, compiled } from "./pictures.js";
import { distanceSeen, Room } from "./room.js";
import { FOVS, type Viewpoint } from "./viewpoint.js";
import { Walk, type Way } from "./walk.js";

/** The field of view along the shorter side in degrees, as in the program's turntables. */
export const USUAL_FOV = 40;
/** Share of the picture that the subject fills along the tighter side. */
const FILLED = 0.9;
/** Number of counted rays along the longer side of a picture. */
const COUNTED_RAYS = 64;
/** Turn in radians and zoom factor per key press. */
const [TURN, ZOOM] = [Math.PI / 24, 1.15];
/** Share of a movement that remains after each frame once the user lets go. */
const DAMPING = 0.15;
/** Duration of a flight to another position, in milliseconds. */
const FLIGHT_MS = 400;

/** Without antialiasing, and with the drawing buffer preserved. */
const CONTEXT = { alpha: true, antialias: false, preserveDrawingBuffer: true };

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera();
  readonly renderer: WebGLRenderer;
  readonly painter: Painter;
  readonly controls: OrbitControls;
  private readonly walk: Walk;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");
  private readonly observer = new ResizeObserver(() => this.resize());
  private angle = USUAL_FOV;
  /** Where the camera may be in a world; null for content viewed from outside. */
  private room: Room | null = null;
  /** Distance of the orbit target, while the camera moves in other ways. */
  private reach = 1;
  /** Start, target and start time of a flight. */
  private flight: { from: Vector3; to: Vector3; aside: Vector3; start: number } | null = null;
  private before = performance.now();
  /** Called after each frame, drawn or not; and when everything is drawn. */
  framed: () => void = () => {};
  rested: () => void = () => {};
  private wasSettled = true;
  /** Limits of the distance from the target in world units, and of the elevation in degrees; null for the defaults. */
  private chosen: { distance: [number, number] | null; elevation: [number, number] | null } = { distance: null, elevation: null };
  /** Ends everything that the stage started on its canvas. */
  private readonly ending = new AbortController();

  constructor(private readonly canvas: HTMLCanvasElement) {
    try {
      this.renderer = new WebGLRenderer({ canvas, ...CONTEXT });
    } catch {
      throw new FieldError("This browser cannot draw with WebGL 2.", REMEDY.browser);
    }
    // Several questions in the first draw, each of which waits for the device. `prepare` asks its own.
    this.renderer.debug.checkShaderErrors = false;
    const { signal } = this.ending;
    this.painter = new Painter(this.renderer, this.scene, this.camera, signal);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.dampingFactor = DAMPING;
    this.controls.addEventListener("change", () => this.painter.move());
    // A hand on the picture ends what moves by itself.
    this.controls.addEventListener("start", () => (this.flight = null));
    this.walk = new Walk(this.camera, canvas, () => this.painter.move(), signal);
    canvas.addEventListener("keydown", (event) => this.key(event), { signal });
    canvas.addEventListener("webglcontextrestored", () => this.redraw(true), { signal });
    this.observer.observe(canvas);
    this.resize();
    this.renderer.setAnimationLoop(() => this.frame());
  }

  /** Redraws as soon as possible. `fresh` shows a coarse picture immediately. */
  redraw(fresh = false): void {
    this.painter.redraw(fresh);
  }

  /** Whether a field is in the picture. */
  get hasDrawn(): boolean {
    let has = false;
    this.scene.traverse((part) => (has ||= "isRadianceField" in part && (part as RadianceField).finest !== null));
    return has && this.painter.frameTime !== null;
  }

  set limits(limits: { distance: [number, number] | null; elevation: [number, number] | null }) {
    this.chosen = limits;
    this.limit();
    this.controls.update();
  }

  private limit(): void {
    const { distance, elevation } = this.chosen;
    const { controls } = this;
    if (distance) [controls.minDistance, controls.maxDistance] = distance;
    [controls.minPolarAngle, controls.maxPolarAngle] = elevation ? [1, 0].map((end) => ((90 - elevation[end]) * Math.PI) / 180) : [0, Math.PI];
  }

  /** The position of a scene point on the canvas, in CSS pixels; null behind the camera. */
  project(place: Vector3): [number, number] | null {
    this.camera.updateMatrixWorld();
    if (place.clone().applyMatrix4(this.camera.matrixWorldInverse).z >= 0) return null;
    const { x, y } = place.clone().project(this.camera);
    return [((x + 1) / 2) * this.canvas.clientWidth, ((1 - y) / 2) * this.canvas.clientHeight];
  }

  /** Whether the picture is complete and shows everything loaded. */
  get settled(): boolean {
    return this.painter.settled && this.flight === null;
  }

  /** Field of view in degrees along the shorter side. */
  get fov(): number {
    return this.angle;
  }

  set fov(degrees: number) {
    this.angle = Math.min(FOVS.most, Math.max(FOVS.least, degrees));
    this.resize();
    this.painter.move();
  }

  /** The way to move; null orbits the target. */
  get way(): Way | null {
    return this.walk.way;
  }

  set way(way: Way | null) {
    // In a world, what is turned around is what is looked at.
    const seen = way === null && this.way && this.room ? (distanceSeen(this.scene, this.renderer, this.camera) ?? this.reach) : undefined;
    this.setWay(way, seen);
  }

  private setWay(way: Way | null, reach = this.camera.position.distanceTo(this.controls.target)): void {
    this.walk.way = way;
    this.reach = reach;
    this.walk.speed = reach / 2;
    this.controls.enabled = way === null;
    if (way) return;
    this.controls.target.copy(this.ahead());
    this.controls.update();
  }

  /** The point ahead of the camera, at the distance of the orbit target. */
  private ahead(): Vector3 {
    return new Vector3(0, 0, -this.reach).applyQuaternion(this.camera.quaternion).add(this.camera.position);
  }

  /** Compiles the shaders and uploads the textures of an object before it is shown, without blocking the page. */
  async prepare(object: Object3D): Promise<void> {
    // Whoever asks a device waits for its pictures, too: better before there are any. It can make textures while it compiles.
    this.upload(object);
    await compiled(this.renderer, object, this.camera, this.scene);
    object.traverse((part) => {
      if ("isRadianceField" in part) (part as RadianceField).warm(this.renderer);
    });
    await new Promise<void>((done) => whenDone(this.renderer.getContext() as WebGL2RenderingContext, done));
  }

  /** Sets the background; null shows the page below the canvas. */
  setBackground(color: Color | null): void {
    this.scene.background = color;
    this.redraw();
  }

  /** Shows a whole box: from inside at the standpoint, if there is one, else from 30 degrees above. */
  show(box: Box3, standpoint: Vector3 | null): void {
    if (standpoint && !box.isEmpty()) this.enter(new Room(box, standpoint));
    else this.lookAt(box);
  }

  private enter(room: Room): void {
    this.room = room;
    this.setWay(null);
    this.flight = null;
    const { radius } = room;
    [this.camera.near, this.camera.far] = [radius / 1000, radius * 100];
    [this.controls.minDistance, this.controls.maxDistance] = [radius / 1000, radius * 4];
    this.limit();
    this.resize();
    this.camera.position.copy(room.standpoint);
    this.controls.target.copy(room.target);
    this.controls.update();
    this.controls.saveState();
    this.setWay(this.home);
    this.redraw(true);
  }

  /** The initial way to move; in worlds, the camera moves freely. */
  private get home(): Way | null {
    return this.room ? "fly" : null;
  }

  /** Looks at a whole box from 30 degrees above. */
  lookAt(box: Box3): void {
    this.room = null;
    if (box.isEmpty()) box = new Box3(new Vector3(-1, -1, -1), new Vector3(1, 1, 1));
    const center = box.getCenter(new Vector3());
    const radius = Math.max(box.getSize(new Vector3()).length() / 2, 1e-6);
    const back = new Vector3(Math.cos(Math.PI / 6), Math.sin(Math.PI / 6), 0);
    this.setWay(null);
    this.flight = null;
    this.camera.near = radius / 1000;
    this.camera.far = radius * 100;
    this.resize();
    this.camera.position.copy(center).add(back);
    this.camera.lookAt(center);
    const high = FILLED * Math.tan((this.camera.fov * Math.PI) / 360);
    const inverse = this.camera.quaternion.clone().invert();
    let distance = radius / 50;
    for (let corner = 0; corner < 8; corner++) {
      const at = new Vector3(corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y, corner & 4 ? box.max.z : box.min.z);
      const { x, y, z } = at.sub(center).applyQuaternion(inverse);
      distance = Math.max(distance, z + Math.abs(x) / (high * this.camera.aspect), z + Math.abs(y) / high);
    }
    this.camera.position.copy(center).addScaledVector(back, distance);
    this.controls.target.copy(center);
    this.controls.minDistance = radius / 100;
    this.controls.maxDistance = radius * 50;
    this.limit();
    this.controls.saveState();
    this.controls.update();
    this.redraw(true);
  }

  get viewpoint(): Viewpoint {
    return { position: this.camera.position.clone(), target: this.way ? this.ahead() : this.controls.target.clone(), fov: this.angle };
  }

  /** Jumps to a viewpoint. */
  set viewpoint({ position, target, fov }: Viewpoint) {
    this.setWay(null);
    this.flight = null;
    if (fov !== null) this.fov = fov;
    this.camera.position.copy(position);
    this.controls.target.copy(target);
    this.controls.update();
    if (this.home) this.setWay(this.home);
    this.painter.move();
  }

  /** Returns to the start. */
  reset(): void {
    this.setWay(null);
    this.flight = null;
    this.controls.reset();
    if (this.home) this.setWay(this.home);
  }

  /** Makes the point shown at these canvas pixels the orbit target. Returns false if nothing is shown there. */
  focus(field: RadianceField, x: number, y: number): boolean {
    const point = field.pick(this.renderer, this.camera, x / this.canvas.clientWidth, y / this.canvas.clientHeight);
    if (!point) return false;
    const { position } = this.camera;
    const target = this.controls.target.clone();
    this.flight = { from: target, to: point, aside: position.clone().sub(target), start: performance.now() };
    return true;
  }

  /** Orbits the camera around its target, by radians to the right and up. */
  orbit(right: number, up: number): void {
    const { target } = this.controls;
    const place = new Spherical().setFromVector3(this.camera.position.clone().sub(target));
    place.theta += right;
    place.phi = Math.min(Math.PI - 0.01, Math.max(0.01, place.phi - up));
    this.camera.position.setFromSpherical(place).add(target);
    this.controls.update();
  }

  /**
   * Renders a picture, rows from the top, from a camera with the transform `toWorld` (column-major) and a focal length
   * in pixels. The stage is unchanged afterwards.
   */
  capture(width: number, height: number, toWorld: number[], focal: number): Uint8ClampedArray {
    const pixels = captured(this.renderer, this.scene, this.camera, { width, height, toWorld, focal });
    this.redraw(true);
    return pixels;
  }

  /** Counts the work of the picture from a few of its rays. */
  count(field: RadianceField, skips: boolean): Statistics {
    const [wide, high] = this.pixels();
    const scale = Math.min(1, COUNTED_RAYS / Math.max(wide, high));
    const [width, height] = [wide, high].map((pixels) => Math.max(1, Math.round(pixels * scale)));
    return field.statistics(this.renderer, this.camera, width, height, high, skips);
  }

  dispose(): void {
    this.ending.abort();
    this.renderer.setAnimationLoop(null);
    this.observer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
    // Browsers keep few contexts, and take away the oldest ones.
    this.renderer.forceContextLoss();
  }

  /** Size of the full picture in pixels. */
  private pixels(): [number, number] {
    const ratio = Math.min(devicePixelRatio, 2);
    return [Math.max(1, Math.round(this.canvas.clientWidth * ratio)), Math.max(1, Math.round(this.canvas.clientHeight * ratio))];
  }

  private resize(): void {
    const [width, height] = this.pixels();
    const aspect = width / height;
    this.camera.aspect = aspect;
    this.camera.fov = (360 / Math.PI) * Math.atan(Math.tan((this.angle * Math.PI) / 360) / Math.min(1, aspect));
    this.camera.updateProjectionMatrix();
    this.painter.resize(width, height);
  }

  private frame(): void {
    if (this.renderer.xr.isPresenting) {
      this.renderer.render(this.scene, this.camera);
      return;
    }
    const now = performance.now();
    // A frame after a pause is no leap.
    this.walk.step(Math.min(0.1, (now - this.before) / 1000));
    this.before = now;
    if (this.flight) this.fly(now);
    else if (this.controls.enabled) {
      this.controls.enableDamping = !this.calm.matches;
      this.controls.update();
    }
    if (this.room?.keep(this.camera.position, this.controls.target)) this.painter.move();
    // A device that is told more than it can do makes the page wait.
    if (!this.painter.isBusy) this.painter.draw(this.upload(this.scene));
    this.framed();
    const isSettled = this.settled;
    if (isSettled && !this.wasSettled) this.rested();
    this.wasSettled = isSettled;
  }

  /**
   * Uploads decoded blocks of all fields in an object, for a few milliseconds. Returns whether more are waiting or
   * being decoded.
   */
  private upload(object: Object3D): boolean {
    let waits = false;
    if (this.renderer.getContext().isContextLost()) return waits;
    object.traverse((part) => {
      if (!("isRadianceField" in part)) return;
      const field = part as RadianceField;
      if (field.upload(this.renderer)) this.redraw(true);
      // A full picture would take the processor from the decoders of what replaces it.
      waits ||= field.waiting || field.decoding;
    });
    return waits;
  }

  private fly(now: number): void {
    const { from, to, aside, start } = this.flight!;
    const share = this.calm.matches ? 1 : Math.min(1, (now - start) / FLIGHT_MS);
    this.controls.target.lerpVectors(from, to, share * share * (3 - 2 * share));
    this.camera.position.copy(this.controls.target).add(aside);
    this.controls.update();
    if (share === 1) this.flight = null;
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey || this.way) return;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) this.pan(arrow);
    else if (arrow) this.orbit(arrow[0] * TURN, arrow[1] * TURN);
    else if (event.key === "+" || event.key === "=") this.zoom(1 / ZOOM);
    else if (event.key === "-") this.zoom(ZOOM);
    else return;
    event.preventDefault();
  }

  private pan([right, up]: [number, number]): void {
    const reach = this.camera.position.distanceTo(this.controls.target) * 0.05;
    const by = new Vector3(right * reach, up * reach, 0).applyQuaternion(this.camera.quaternion);
    this.camera.position.add(by);
    this.controls.target.add(by);
    this.controls.update();
  }

  private zoom(by: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target).multiplyScalar(by);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }
}
