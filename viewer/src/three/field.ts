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
import { pickedProjection, RAY_PROJECTION, type Statistics, statisticsOf } from "../render/measures.js";
import { OUTPUT } from "../render/shader.js";
import { fieldUniforms, NOWHERE, type Shown, type View, viewUniforms } from "../render/uniforms.js";
import type { Budget, FieldEvents, FieldOptions, Owner } from "../fieldOptions.js";
import { StreamedField } from "../streamed.js";
import { aloneOf, onePixel, pointAt } from "./alone.js";
import { FieldMaterial, type Draw } from "./material.js";
import { type AnyRenderer, attachments, deviceOf, isWebGL } from "./view.js";
import { gpuDrawing } from "./drawing.js";

/** Events of `RadianceField`, in addition to those of all three.js objects. */
export interface RadianceFieldEventMap extends Object3DEventMap, FieldEvents {}

/** A draw range that three.js skips. It does not skip a range of length 0, which would need matching textures too. */
const NOTHING = [0, -1] as const;

/**
 * Marches rays through a baked field, inside its box. Local axes are those of training, z up: in a scene with y up,
 * rotate the object by a quarter turn about x.
 */
export class RadianceField extends Mesh<BufferGeometry, ShaderMaterial, RadianceFieldEventMap> {
  readonly isRadianceField = true;
  /** Resolves when the metadata is available; rejects if it cannot be loaded. */
  readonly opened: Promise<Metadata>;
  /** Resolves when every level is loaded. */
  readonly finished: Promise<void>;
  /** Whether colours show levels. */
  showLevels = false;
  /** The level to show, 0 being the finest; null follows the field's rule. */
  fixedLevel: number | null = null;
  /**
   * Whether rays respect the near and far of the training cameras, as in the reference renderer, to measure pictures.
   */
  keepsRange = false;
  private readonly streamed: StreamedField;
  private readonly owner: Owner = {
    begin: (opened) => this.begin(opened),
    tell: (type, event) => this.dispatchEvent({ type, ...event } as never),
  };
  /** The renderer that drew the field last; raycasts use it. */
  private renderer: AnyRenderer | null = null;
  /** Reasons for not drawing that were already reported; each is reported once. */
  private readonly told = new Set<string>();
  /** The output to draw instead of a picture; null for pictures. */
  private sampled: Partial<Shown> | null = null;
  /** A scene with only the field, for outputs other than pictures. */
  private alone: { scene: Scene; mesh: Mesh } | null = null;

  /**
   * Loads `source`, the address of a container or its bytes. Given another field, shares its loaded data and its device
   * memory. The field is drawn as soon as the coarsest levels are loaded.
   */
  constructor(source: Source | RadianceField, options?: FieldOptions) {
    super(new BoxGeometry(), new ShaderMaterial());
    this.geometry.setDrawRange(...NOTHING);
    this.name = "MIPVOG_radiance_field";
    this.streamed = source instanceof RadianceField ? source.streamed : new StreamedField(source, options);
    ({ opened: this.opened, finished: this.finished } = this.streamed);
    this.streamed.join(this.owner);
  }

  /** Another object of the same field, which is loaded and stored only once. */
  override clone(recursive = true): this {
    return new RadianceField(this).copy(this, recursive) as this;
  }

  /** Copies everything except the field itself. */
  override copy(source: this, recursive?: boolean): this {
    const { geometry, material } = this;
    super.copy(source, recursive);
    // Uniforms are each object's own.
    [this.geometry, this.material] = [geometry, material];
    [this.showLevels, this.fixedLevel, this.keepsRange] = [source.showLevels, source.fixedLevel, source.keepsRange];
    return this;
  }

  /** Number of bytes received. */
  get arrived(): number {
    return this.streamed.arrived;
  }

  /** Contents of the file; null until it is opened. */
  get metadata(): Metadata | null {
    return this.streamed.file?.metadata ?? null;
  }

  /** How the file was transferred and what the device holds of it; null until it is opened. */
  get file(): Pick<Opened, "fileBytes" | "available" | "prefixes" | "transfer" | "plan"> | null {
    return this.streamed.file;
  }

  /**
   * Uploads decoded blocks to the device, for a few milliseconds; every draw does this too. Returns whether the picture
   * has changed.
   */
  upload(renderer: AnyRenderer): boolean {
    const device = deviceOf(renderer);
    return device !== null && this.streamed.upload(device);
  }

  /** Device memory of the field, and how many of its blocks fit; null until it is opened. */
  get budget(): Budget | null {
    return this.streamed.budget;
  }

  /** The finest level shown; null before the first picture. */
  get finest(): number | null {
    return this.streamed.finest;
  }

  /** Whether loaded levels wait for upload with the next pictures. */
  get waiting(): boolean {
    return this.streamed.waiting;
  }

  /** Whether the bytes of a level are being decoded. */
  get decoding(): boolean {
    return this.streamed.decoding;
  }

  /**
   * The visible part of the box in local axes; the whole box before the first level. For a world, the innermost box.
   */
  get visibleBounds(): Box3 {
    const [min, max] = this.streamed.visible;
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** The box of the whole field in local axes. */
  get bounds(): Box3 {
    const { min, max } = this.metadata ? outerBounds(this.metadata) : { min: [0, 0, 0], max: [0, 0, 0] };
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** Whether the field is a world: viewed from inside, with boxes around that of its finest level. */
  get isWorld(): boolean {
    return this.metadata !== null && isNested(this.metadata);
  }

  /**
   * A viewing position in a world, in local axes: the centre of its free space, or of the innermost box until known.
   */
  get standpoint(): Vector3 {
    return new Vector3(...this.streamed.standpoint);
  }

  /** Stops drawing the field. With the last object that shares it, loading ends and the device memory is freed. */
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

  /** Keeps other passes from drawing the box, such as shadows or override materials. */
  override onAfterRender = (): void => {
    this.geometry.setDrawRange(...NOTHING);
  };

  /** Intersects what pictures show, as `pick` does. Hits nothing before the first picture. */
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
   * Counts the work of a picture with `rows` rows, using `width` by `height` of its rays. Without `skips`, counts a
   * dense march: every sample between entry and exit, with its colours.
   */
  statistics(renderer: WebGLRenderer, camera: Camera, width: number, height: number, rows: number, skips = true): Statistics {
    return statisticsOf(this.sample(renderer, camera, width, height, counted(height, rows, skips)));
  }

  /** As `statistics`, also for WebGPU renderers. */
  async statisticsAsync(renderer: AnyRenderer, camera: Camera, width: number, height: number, rows: number, skips = true): Promise<Statistics> {
    return statisticsOf(await this.sampleAsync(renderer, camera, width, height, counted(height, rows, skips)));
  }

  /**
   * The world position that a picture shows at `x`, `y`, fractions of its width and height from the top left. Null if
   * the field is nearly transparent there.
   */
  pick(renderer: WebGLRenderer, camera: Camera, x: number, y: number): Vector3 | null {
    return this.pointOf(renderer, camera.matrixWorld, pickedProjection(camera.projectionMatrix.elements, x, y));
  }

  /** As `pick`, also for WebGPU renderers. */
  async pickAsync(renderer: AnyRenderer, camera: Camera, x: number, y: number): Promise<Vector3 | null> {
    if (!isWebGL(renderer)) gpuDrawing()?.ready(renderer, camera);
    const projection = pickedProjection(camera.projectionMatrix.elements, x, y);
    const place = camera.matrixWorld.clone();
    return pointAt(await this.sampleAsync(renderer, onePixel(place, projection, camera), 1, 1, { output: OUTPUT.distance }), place, projection);
  }

  /** The world position that a camera at `place` sees in its one pixel. */
  private pointOf(renderer: WebGLRenderer, place: Matrix4, projection: readonly number[]): Vector3 | null {
    return pointAt(this.sample(renderer, onePixel(place, projection), 1, 1, { output: OUTPUT.distance }), place, projection);
  }

  /**
   * Draws an invisible pixel from the centre of the box, with everything that a draw may need. Devices compile code in
   * the first draw that needs it, which would delay the visible picture.
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

  /** One kind of output, four numbers per pixel. */
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

  /** Draws only the field into an empty target. */
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

  /** Builds everything that does not depend on levels. */
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
   * Runs before every draw: uploads waiting levels and updates uniforms from the camera. `object` is this field, or a
   * mesh with its material and geometry. Null if nothing is drawn.
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

  /** Reports once why the field is not drawn: an exception would end the picture of the whole scene. */
  private refuse(message: string, remedy: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.error(`${message} ${remedy}`);
    this.dispatchEvent({ type: "failed", error: new FieldError(message, remedy) });
  }

  /** Warns once of something that does not prevent drawing. */
  private warn(message: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.warn(message);
  }
}

/** The message for WebGPU renderers that were not prepared. */
const REFUSED = ["A WebGPURenderer draws fields only where mipvog-viewer/webgpu is imported.", REMEDY.webgpu] as const;

/** What to show while the work of a picture is counted. */
function counted(height: number, rows: number, skips: boolean): Partial<Shown> {
  return { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows };
}

/** @ts-ignore if react-three-fiber is not installed */
declare module "@react-three/fiber" {
  interface ThreeElements {
    /** @ts-ignore as above; after `extend({ RadianceField })` */
    radianceField: import("@react-three/fiber").ThreeElement<typeof RadianceField>;
  }
}
