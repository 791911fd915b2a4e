/** A baked radiance field as an object of a three.js scene. */

import {
  type ArrayCamera,
  Box3,
  BoxGeometry,
  type BufferGeometry,
  type Camera,
  FloatType,
  type Intersection,
  Matrix4,
  Mesh,
  NoBlending,
  NormalBlending,
  type Object3DEventMap,
  PerspectiveCamera,
  type Raycaster,
  Scene,
  ShaderMaterial,
  Vector3,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { FieldError, REMEDY } from "../errors.js";
import type { Metadata } from "../format/metadata.js";
import { isNested, outerBounds } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import type { Source } from "../load/source.js";
import { lookingAlong } from "../render/matrices.js";
import { pickedPoint, pickedProjection, RAY_PROJECTION, type Statistics, statisticsOf } from "../render/measures.js";
import { OUTPUT } from "../render/shader.js";
import { fieldUniforms, NOWHERE, type Shown, type View, viewUniforms } from "../render/uniforms.js";
import { type Budget, type FieldEvents, type FieldOptions, type Owner, StreamedField } from "../streamed.js";
import { FieldMaterial, type Draw } from "./material.js";
import { type AnyRenderer, attachments, deviceOf, isWebGL } from "./view.js";
import { gpuDrawing } from "./drawing.js";

/** What `RadianceField` tells, beside what all objects of three.js tell. */
export interface RadianceFieldEventMap extends Object3DEventMap, FieldEvents {}

/** A range that three.js does not draw. It does draw one of no length, for which textures have to fit, too. */
const NOTHING = [0, -1] as const;

/**
 * Marches rays through a baked field, in the box that the field spans. Its local axes are those of training, z up:
 * a node of a scene whose y is up turns it by a quarter about x.
 */
export class RadianceField extends Mesh<BufferGeometry, ShaderMaterial, RadianceFieldEventMap> {
  readonly isRadianceField = true;
  /** Resolves once the metadata is there; rejects where it cannot be. */
  readonly opened: Promise<Metadata>;
  /** Resolves once every level is there. */
  readonly finished: Promise<void>;
  /** Whether colours tell levels. */
  showLevels = false;
  /** The level to show, 0 being the finest; null follows the field's rule. */
  fixedLevel: number | null = null;
  /** Whether rays keep to the near and far of the training cameras, as the reference renderer does: to measure pictures. */
  keepsRange = false;
  private readonly streamed: StreamedField;
  private readonly owner: Owner = {
    begin: (opened) => this.begin(opened),
    tell: (type, event) => this.dispatchEvent({ type, ...event } as never),
  };
  /** What drew the field last: rays are cast with it. */
  private renderer: AnyRenderer | null = null;
  /** Why it was not drawn; each reason is told once. */
  private readonly told = new Set<string>();
  /** What is drawn in place of a picture; null for pictures. */
  private sampled: Partial<Shown> | null = null;
  /** The field alone in a scene, for what is drawn in place of pictures. */
  private alone: { scene: Scene; mesh: Mesh } | null = null;

  /**
   * Loads `source`, the address of a container or its bytes; another field shares what it has loaded, and what the device
   * holds. Draws as soon as the coarsest levels are there.
   */
  constructor(source: Source | RadianceField, options?: FieldOptions) {
    super(new BoxGeometry(), new ShaderMaterial());
    this.geometry.setDrawRange(...NOTHING);
    this.name = "MIPVOG_radiance_field";
    this.streamed = source instanceof RadianceField ? source.streamed : new StreamedField(source, options);
    ({ opened: this.opened, finished: this.finished } = this.streamed);
    this.streamed.join(this.owner);
  }

  /** Another object of the same field, which is loaded and held once. */
  override clone(recursive = true): this {
    return new RadianceField(this).copy(this, recursive) as this;
  }

  /** Takes over everything but the field itself. */
  override copy(source: this, recursive?: boolean): this {
    const { geometry, material } = this;
    super.copy(source, recursive);
    // Uniforms are each object's own.
    [this.geometry, this.material] = [geometry, material];
    [this.showLevels, this.fixedLevel, this.keepsRange] = [source.showLevels, source.fixedLevel, source.keepsRange];
    return this;
  }

  /** Bytes that have arrived. */
  get arrived(): number {
    return this.streamed.arrived;
  }

  /** What is in the file; null until it is opened. */
  get metadata(): Metadata | null {
    return this.streamed.file?.metadata ?? null;
  }

  /** How the file came and what of it the device holds; null until it is opened. */
  get file(): Pick<Opened, "fileBytes" | "available" | "prefixes" | "transfer" | "plan"> | null {
    return this.streamed.file;
  }

  /**
   * Brings decoded blocks to the device, for a few milliseconds; every draw does this as well. Whether the picture has
   * changed.
   */
  upload(renderer: AnyRenderer): boolean {
    const device = deviceOf(renderer);
    return device !== null && this.streamed.upload(device);
  }

  /** What the field takes of the device's memory, and what of its blocks has room; null until it is opened. */
  get budget(): Budget | null {
    return this.streamed.budget;
  }

  /** The finest level that is shown; null before the first picture. */
  get finest(): number | null {
    return this.streamed.finest;
  }

  /** Whether levels have come that the next pictures will bring to the device. */
  get waiting(): boolean {
    return this.streamed.waiting;
  }

  /** Whether a level's bytes are there and are being decoded. */
  get decoding(): boolean {
    return this.streamed.decoding;
  }

  /** The part of the box, in local axes, where something is to be seen; all of it before the first level. Of a world the innermost box. */
  get visibleBounds(): Box3 {
    const [min, max] = this.streamed.visible;
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** The box of everything in local axes. */
  get bounds(): Box3 {
    const { min, max } = this.metadata ? outerBounds(this.metadata) : { min: [0, 0, 0], max: [0, 0, 0] };
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** Whether the field is a world: seen from inside, with boxes around that of its finest level. */
  get isWorld(): boolean {
    return this.metadata !== null && isNested(this.metadata);
  }

  /** In local axes, where one may stand in a world: the middle of its free space; that of the innermost box before it is known. */
  get standpoint(): Vector3 {
    return new Vector3(...this.streamed.standpoint);
  }

  /**
   * The field is not drawn any more. With the last object that shares it, loading ends and the device's memory is free.
   */
  dispose(): void {
    this.streamed.leave(this.owner);
    this.visible = false;
    this.geometry.dispose();
    this.material.dispose();
  }

  override onBeforeRender = (renderer: AnyRenderer, _scene: Scene, camera: Camera): void => {
    this.geometry.setDrawRange(...NOTHING);
    if (isWebGL(renderer)) return;
    const drawing = gpuDrawing();
    const refusal = drawing ? drawing.adopt(renderer) : REFUSED;
    if (drawing && this.material instanceof FieldMaterial) this.material.variant = drawing.variant(renderer);
    if (refusal) this.refuse(...refusal);
    else if ((camera as ArrayCamera).isArrayCamera) this.refuse("With WebGPU, a field is not drawn for a camera of several views.", REMEDY.views);
  };

  /** No other pass draws the box in the field's place: that of shadows, or one with a material of its own. */
  override onAfterRender = (): void => {
    this.geometry.setDrawRange(...NOTHING);
  };

  /** Hits what pictures show, as `pick` does; nothing before the first picture. */
  override raycast({ ray, near, far }: Raycaster, intersects: Intersection[]): void {
    const { renderer } = this;
    const box = (this.isWorld ? this.bounds : this.visibleBounds).applyMatrix4(this.matrixWorld);
    if (!renderer || !this.visible || this.streamed.finest === null || !ray.intersectsBox(box)) return;
    if (!isWebGL(renderer)) return this.warn("Rays do not hit fields that WebGPU draws, because its answers come later. Use pickAsync.");
    const point = this.pointOf(renderer, new Matrix4().fromArray(lookingAlong(ray.origin.toArray(), ray.direction.toArray())), RAY_PROJECTION);
    const distance = point?.distanceTo(ray.origin) ?? Infinity;
    if (point && distance >= near && distance <= far) intersects.push({ distance, point, object: this });
  }

  /**
   * Counts what a picture of `rows` rows takes, from `width` by `height` rays of it. Without `skips` as a dense march
   * would: every sample between entry and exit, with its colours.
   */
  statistics(renderer: WebGLRenderer, camera: Camera, width: number, height: number, rows: number, skips = true): Statistics {
    return statisticsOf(this.sample(renderer, camera, width, height, counted(height, rows, skips)));
  }

  /** As `statistics`, with renderers for WebGPU, too. */
  async statisticsAsync(renderer: AnyRenderer, camera: Camera, width: number, height: number, rows: number, skips = true): Promise<Statistics> {
    return statisticsOf(await this.sampleAsync(renderer, camera, width, height, counted(height, rows, skips)));
  }

  /**
   * The world's point that a picture shows at `x`, `y`, shares of its width and height from the top left; null where the
   * field is next to invisible.
   */
  pick(renderer: WebGLRenderer, camera: Camera, x: number, y: number): Vector3 | null {
    return this.pointOf(renderer, camera.matrixWorld, pickedProjection(camera.projectionMatrix.elements, x, y));
  }

  /** As `pick`, with renderers for WebGPU, too. */
  async pickAsync(renderer: AnyRenderer, camera: Camera, x: number, y: number): Promise<Vector3 | null> {
    if (!isWebGL(renderer)) gpuDrawing()?.ready(renderer, camera);
    const projection = pickedProjection(camera.projectionMatrix.elements, x, y);
    const place = camera.matrixWorld.clone();
    return pointAt(await this.sampleAsync(renderer, onePixel(place, projection, camera), 1, 1, { output: OUTPUT.distance }), place, projection);
  }

  /** The world's point that a camera at `place` sees in its one pixel. */
  private pointOf(renderer: WebGLRenderer, place: Matrix4, projection: readonly number[]): Vector3 | null {
    return pointAt(this.sample(renderer, onePixel(place, projection), 1, 1, { output: OUTPUT.distance }), place, projection);
  }

  /**
   * Draws a pixel that nobody sees, from the middle of the box, with all that a draw may need. Devices make code in the first
   * draw that needs it, and what is on the screen would wait for that.
   */
  warm(renderer: AnyRenderer): void {
    if (!this.metadata || !deviceOf(renderer)) return;
    const camera = new PerspectiveCamera();
    const middle = this.bounds.getCenter(new Vector3());
    camera.matrixWorld.copy(this.matrixWorld).multiply(new Matrix4().setPosition(middle));
    camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
    camera.matrixWorldAutoUpdate = camera.matrixAutoUpdate = false;
    // With a stencil, as the depth buffers of canvases have: the code depends on it.
    const target = new WebGLRenderTarget(1, 1, { stencilBuffer: true });
    this.drawInto(target, renderer, camera, { finest: this.metadata.levels.length - 1, keepsRange: false, skips: false });
    target.dispose();
  }

  /** Four numbers a pixel of one kind of output. */
  private sample(renderer: WebGLRenderer, camera: Camera, width: number, height: number, shown: Partial<Shown>): Float32Array {
    if (!isWebGL(renderer)) throw new FieldError("Renderers for WebGPU answer later, not at once.", REMEDY.later);
    const target = new WebGLRenderTarget(width, height, { type: FloatType });
    const pixels = new Float32Array(4 * width * height);
    this.drawValues(target, renderer, camera, shown);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    target.dispose();
    return pixels;
  }

  private async sampleAsync(renderer: AnyRenderer, camera: Camera, width: number, height: number, shown: Partial<Shown>): Promise<Float32Array> {
    if (isWebGL(renderer)) return this.sample(renderer, camera, width, height, shown);
    const drawing = gpuDrawing();
    const refusal = drawing ? drawing.adopt(renderer) : REFUSED;
    if (!drawing || refusal) throw new FieldError(...refusal!);
    const target = new WebGLRenderTarget(width, height, { type: FloatType });
    try {
      drawing.ready(renderer, camera);
      this.drawValues(target, renderer, camera, shown);
      return await drawing.read(renderer, target);
    } finally {
      target.dispose();
    }
  }

  private drawValues(target: WebGLRenderTarget, renderer: AnyRenderer, camera: Camera, shown: Partial<Shown>): void {
    this.material.blending = NoBlending;
    this.drawInto(target, renderer, camera, shown);
    this.material.blending = NormalBlending;
  }

  /** Draws the field alone into an empty target. */
  private drawInto(target: WebGLRenderTarget, any: AnyRenderer, camera: Camera, shown: Partial<Shown>): void {
    // What is used of it here, renderers for WebGPU have as well.
    const renderer = any as WebGLRenderer;
    this.alone ??= aloneOf(this);
    const { scene, mesh } = this.alone;
    [mesh.geometry, mesh.material] = [this.geometry, this.material];
    mesh.matrixWorld.copy(this.matrixWorld);
    const [before, alpha, xr] = [renderer.getRenderTarget(), renderer.getClearAlpha(), renderer.xr.enabled];
    renderer.setRenderTarget(target);
    renderer.setClearAlpha(0);
    // A headset has cameras of its own.
    renderer.xr.enabled = false;
    this.sampled = shown;
    renderer.clear();
    renderer.render(scene, camera);
    this.sampled = null;
    renderer.xr.enabled = xr;
    renderer.setRenderTarget(before);
    renderer.setClearAlpha(alpha);
    this.geometry.setDrawRange(...NOTHING);
  }

  /** Builds what does not depend on levels. */
  private begin(opened: Opened): void {
    const { min, max } = outerBounds(opened.metadata);
    const size = min.map((min, axis) => max[axis] - min);
    this.geometry.dispose();
    this.geometry = new BoxGeometry(size[0], size[1], size[2]).translate(min[0] + size[0] / 2, min[1] + size[1] / 2, min[2] + size[2] / 2);
    this.geometry.setDrawRange(...NOTHING);
    this.material.dispose();
    const uniforms = { ...fieldUniforms(opened), ...viewUniforms(opened.metadata, NOWHERE, { finest: 0, fixedLevel: null, keepsRange: false }) };
    this.material = new FieldMaterial(opened, uniforms, (renderer, object, view) => this.prepare(renderer, object, view));
  }

  /**
   * Before every draw: levels that wait go to the device, uniforms follow the camera. `object` is this one, or a plain mesh
   * that somebody has given its material and geometry. Null where nothing is drawn.
   */
  private prepare(renderer: AnyRenderer, { geometry }: Mesh, view: () => View): Draw | null {
    geometry.setDrawRange(...NOTHING);
    if (attachments((renderer as WebGLRenderer).getRenderTarget()) > 1) {
      this.refuse("A field is not drawn into a target of several color attachments.", REMEDY.attachments);
      return null;
    }
    this.upload(renderer);
    const { file } = this.streamed;
    const device = deviceOf(renderer);
    const held = device && this.streamed.on(device);
    const shown = this.sampled ?? { output: this.showLevels ? OUTPUT.levels : OUTPUT.color };
    const finest = this.sampled?.finest ?? held?.finest ?? null;
    if (!file || !held?.textures || finest === null) return null;
    geometry.setDrawRange(0, Infinity);
    if (!this.sampled) this.renderer = renderer;
    const { keepsRange, fixedLevel } = this;
    const seen = view();
    if (!this.sampled) this.streamed.look(seen);
    return { textures: held.textures, uniforms: viewUniforms(file.metadata, seen, { finest, fixedLevel, keepsRange, ...shown }) };
  }

  /** Tells once why the field is not drawn: an error would end the whole scene's picture. */
  private refuse(message: string, remedy: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.error(`${message} ${remedy}`);
    this.dispatchEvent({ type: "failed", error: new FieldError(message, remedy) });
  }

  /** Says once what does not keep the field from being drawn. */
  private warn(message: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.warn(message);
  }
}

/** What is said where renderers for WebGPU were not prepared. */
const REFUSED = ["A WebGPURenderer draws fields only where mipvog-viewer/webgpu is imported.", REMEDY.webgpu] as const;

/** What is shown where the work of a picture is counted. */
function counted(height: number, rows: number, skips: boolean): Partial<Shown> {
  return { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows };
}

/** A camera of one pixel. It keeps the convention of `like`, so that no renderer makes a projection of its own. */
function onePixel(place: Matrix4, projection: readonly number[], like?: Camera): Camera {
  const one = new PerspectiveCamera();
  one.matrixWorldAutoUpdate = one.matrixAutoUpdate = false;
  one.matrixWorld.copy(place);
  one.matrixWorldInverse.copy(place).invert();
  if (like) one.coordinateSystem = like.coordinateSystem;
  one.projectionMatrix.fromArray(projection);
  return one;
}

function pointAt(pixel: Float32Array, place: Matrix4, projection: readonly number[]): Vector3 | null {
  const point = pickedPoint(pixel, place.elements, projection);
  return point && new Vector3(...point);
}

/** A scene of a mesh that will be drawn in a field's place. */
function aloneOf(field: RadianceField): { scene: Scene; mesh: Mesh } {
  const mesh = new Mesh<BufferGeometry, ShaderMaterial>(field.geometry, field.material);
  mesh.matrixWorldAutoUpdate = mesh.matrixAutoUpdate = mesh.frustumCulled = false;
  const scene = new Scene();
  scene.matrixWorldAutoUpdate = false;
  return { scene: scene.add(mesh) as Scene, mesh };
}

/** @ts-ignore where react-three-fiber is not installed, nothing is said of it. */
declare module "@react-three/fiber" {
  interface ThreeElements {
    /** @ts-ignore as above; after `extend({ RadianceField })` */
    radianceField: import("@react-three/fiber").ThreeElement<typeof RadianceField>;
  }
}
