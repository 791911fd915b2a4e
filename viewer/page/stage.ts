/** The canvas: camera, controls, and drawing when something has changed. */

import { Box3, Color, type Object3D, PerspectiveCamera, Scene, Sphere, SRGBColorSpace, Vector2, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { RadianceField, Statistics } from "../src/index.js";

/** A field of view of about 40 degrees along the shorter side, as the program's turntables. */
const HALF_ANGLE = 0.35;
/** While something moves, pictures that take longer than this are drawn with fewer pixels. */
const SMOOTH_MS = 40;
/** Pixels along a side, of those of the screen, at least. */
const COARSEST = 0.25;
/** Without a move for this long, pictures are sharp again. */
const REST_MS = 200;
/** Rays along the longer side of a picture that are counted. */
const COUNTED_RAYS = 64;
/** Radians that a key turns, and what it zooms by. */
const [TURN, ZOOM] = [Math.PI / 24, 1.15];

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera();
  readonly renderer: WebGLRenderer;
  /** The time that the last picture took, in milliseconds; null before. */
  frameTime: number | null = null;
  /** Called after each picture. */
  drawn: () => void = () => {};
  private readonly controls: OrbitControls;
  private stale = true;
  private busy = false;
  private sharpness = 1;
  private moved = -Infinity;
  private fixedSize: [number, number] | null = null;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false });
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => {
      this.moved = performance.now();
      this.redraw();
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("webglcontextrestored", () => this.redraw());
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.setBackground([1, 1, 1]);
    this.resize();
    const loop = () => {
      this.draw();
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  /** Draws again as soon as may be. */
  redraw(): void {
    this.stale = true;
  }

  /** Whether the picture shows all there is. */
  get settled(): boolean {
    return !this.stale && !this.busy && this.sharpness === 1;
  }

  setBackground(color: [number, number, number]): void {
    this.scene.background = new Color().setRGB(...color, SRGBColorSpace);
  }

  /** Looks at an object from 30 degrees above, all of it in the picture. */
  lookAt(object: Object3D): void {
    object.updateWorldMatrix(true, true);
    const sphere = new Box3().setFromObject(object).getBoundingSphere(new Sphere());
    if (sphere.radius <= 0) sphere.set(new Vector3(), 1);
    const distance = sphere.radius / Math.sin(HALF_ANGLE);
    const back = new Vector3(Math.cos(Math.PI / 6), Math.sin(Math.PI / 6), 0);
    this.camera.position.copy(sphere.center).addScaledVector(back, distance);
    this.camera.near = sphere.radius / 1000;
    this.camera.far = sphere.radius * 100;
    this.controls.target.copy(sphere.center);
    this.controls.minDistance = sphere.radius / 100;
    this.controls.maxDistance = sphere.radius * 50;
    this.controls.saveState();
    this.resize();
    this.controls.update();
  }

  /** Starts over. */
  reset(): void {
    this.controls.reset();
  }

  /** Turns the camera around what it looks at, by radians to the right and up. */
  orbit(right: number, up: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const polar = Math.acos(offset.y / offset.length());
    const raised = Math.min(Math.PI - 0.01, Math.max(0.01, polar - up)) - polar;
    offset.applyAxisAngle(new Vector3(0, 1, 0), right);
    const axis = new Vector3(0, 1, 0).cross(offset).normalize();
    offset.applyAxisAngle(axis, raised);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }

  /**
   * The pixels, rows from the top, of a picture from a camera of `toWorld` (column by column) and a focal length in
   * pixels. The stage is as before afterwards.
   */
  capture(width: number, height: number, toWorld: number[], focal: number): Uint8ClampedArray {
    this.fixedSize = [width, height];
    this.resize();
    const camera = new PerspectiveCamera(1, 1, this.camera.near, this.camera.far);
    camera.matrixWorldAutoUpdate = camera.matrixAutoUpdate = false;
    camera.matrixWorld.fromArray(toWorld);
    camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
    const [x, y] = [(width / 2 / focal) * camera.near, (height / 2 / focal) * camera.near];
    camera.projectionMatrix.makePerspective(-x, x, y, -y, camera.near, camera.far);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    this.renderer.render(this.scene, camera);
    const gl = this.renderer.getContext();
    const rows = new Uint8ClampedArray(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    const pixels = new Uint8ClampedArray(rows.length);
    for (let row = 0; row < height; row++) pixels.set(rows.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    this.fixedSize = null;
    this.resize();
    return pixels;
  }

  private resize(): void {
    const [width, height] = this.fixedSize ?? [this.canvas.clientWidth, this.canvas.clientHeight];
    const ratio = this.fixedSize ? 1 : Math.min(devicePixelRatio, 2) * this.sharpness;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(Math.max(1, width), Math.max(1, height), false);
    const aspect = Math.max(1, width) / Math.max(1, height);
    this.camera.aspect = aspect;
    this.camera.fov = (360 / Math.PI) * Math.atan(Math.tan(HALF_ANGLE) / Math.min(1, aspect));
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  private draw(): void {
    if (this.busy || this.renderer.getContext().isContextLost()) return;
    const moving = performance.now() - this.moved < REST_MS;
    if (!moving && this.sharpness < 1) {
      this.sharpness = 1;
      this.resize();
    }
    if (!this.stale) return;
    this.stale = false;
    const start = performance.now();
    this.renderer.render(this.scene, this.camera);
    this.busy = true;
    this.whenDone(() => {
      this.busy = false;
      this.frameTime = performance.now() - start;
      if (moving && this.frameTime > SMOOTH_MS && this.sharpness > COARSEST) {
        this.sharpness = Math.max(COARSEST, this.sharpness * Math.max(0.5, Math.sqrt(SMOOTH_MS / this.frameTime)));
        this.resize();
      }
      this.drawn();
    });
  }

  /** Calls back when the device has done what it was told. */
  private whenDone(then: () => void): void {
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (fence && !gl.isContextLost() && gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED) {
        setTimeout(look, 1);
        return;
      }
      gl.deleteSync(fence);
      then();
    };
    look();
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) this.pan(arrow);
    else if (arrow) this.orbit(arrow[0] * TURN, arrow[1] * TURN);
    else if (event.key === "+" || event.key === "=") this.zoom(1 / ZOOM);
    else if (event.key === "-") this.zoom(ZOOM);
    else if (event.key.toLowerCase() === "r") this.reset();
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

  /** Counts what the picture takes, from a few of its rays. */
  count(field: RadianceField, skips: boolean): Statistics {
    const size = this.renderer.getDrawingBufferSize(new Vector2());
    const scale = Math.min(1, COUNTED_RAYS / Math.max(size.x, size.y));
    const [width, height] = [size.x, size.y].map((pixels) => Math.max(1, Math.round(pixels * scale)));
    return field.statistics(this.renderer, this.camera, width, height, size.y, skips);
  }
}
