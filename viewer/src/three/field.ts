/** A baked radiance field as an object of a three.js scene. */

import {
  BackSide,
  Box3,
  BoxGeometry,
  type BufferGeometry,
  type Camera,
  Data3DTexture,
  FloatType,
  GLSL3,
  type Intersection,
  Matrix4,
  Mesh,
  NoBlending,
  NormalBlending,
  type Object3D,
  type Object3DEventMap,
  PerspectiveCamera,
  type Raycaster,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  Texture,
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
import { fragmentShader, OUTPUT, VERTEX } from "../render/shader.js";
import { SAMPLERS } from "../render/textures.js";
import { fieldUniforms, type Shown, viewUniforms } from "../render/uniforms.js";
import { type Budget, type FieldEvents, type FieldOptions, type Owner, StreamedField } from "../streamed.js";
import { attachments, isWebGL, NOWHERE, viewOf } from "./view.js";

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
  private renderer: WebGLRenderer | null = null;
  /** Why it was not drawn; each reason is told once. */
  private readonly told = new Set<string>();
  /** What is drawn in place of a picture; null for pictures. */
  private sampled: Partial<Shown> | null = null;

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
  upload(renderer: WebGLRenderer): boolean {
    return this.streamed.upload(renderer.getContext() as WebGL2RenderingContext);
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

  override onBeforeRender = (renderer: WebGLRenderer): void => {
    this.geometry.setDrawRange(...NOTHING);
    if (!isWebGL(renderer)) this.refuse("Fields are drawn by three.js's WebGLRenderer, and by no other.", REMEDY.renderer);
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
    const point = this.pointOf(renderer, new Matrix4().fromArray(lookingAlong(ray.origin.toArray(), ray.direction.toArray())), RAY_PROJECTION);
    const distance = point?.distanceTo(ray.origin) ?? Infinity;
    if (point && distance >= near && distance <= far) intersects.push({ distance, point, object: this });
  }

  /**
   * Counts what a picture of `rows` rows takes, from `width` by `height` rays of it. Without `skips` as a dense march
   * would: every sample between entry and exit, with its colours.
   */
  statistics(renderer: WebGLRenderer, camera: Camera, width: number, height: number, rows: number, skips = true): Statistics {
    return statisticsOf(this.sample(renderer, camera, width, height, { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows }));
  }

  /**
   * The world's point that a picture shows at `x`, `y`, shares of its width and height from the top left; null where the
   * field is next to invisible.
   */
  pick(renderer: WebGLRenderer, camera: Camera, x: number, y: number): Vector3 | null {
    return this.pointOf(renderer, camera.matrixWorld, pickedProjection(camera.projectionMatrix.elements, x, y));
  }

  /** The world's point that a camera at `place` sees in its one pixel. */
  private pointOf(renderer: WebGLRenderer, place: Matrix4, projection: readonly number[]): Vector3 | null {
    const one = new PerspectiveCamera();
    one.matrixWorldAutoUpdate = one.matrixAutoUpdate = false;
    one.matrixWorld.copy(place);
    one.matrixWorldInverse.copy(place).invert();
    one.projectionMatrix.fromArray(projection);
    const pixel = this.sample(renderer, one, 1, 1, { output: OUTPUT.distance });
    const point = pickedPoint(pixel, place.elements, projection);
    return point && new Vector3(...point);
  }

  /**
   * Draws a pixel that nobody sees, from the middle of the box, with all that a draw may need. Devices make code in the first
   * draw that needs it, and what is on the screen would wait for that.
   */
  warm(renderer: WebGLRenderer): void {
    if (!this.metadata) return;
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
    const target = new WebGLRenderTarget(width, height, { type: FloatType });
    const pixels = new Float32Array(4 * width * height);
    this.material.blending = NoBlending;
    this.drawInto(target, renderer, camera, shown);
    this.material.blending = NormalBlending;
    renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    target.dispose();
    return pixels;
  }

  /** Draws the field alone into an empty target. */
  private drawInto(target: WebGLRenderTarget, renderer: WebGLRenderer, camera: Camera, shown: Partial<Shown>): void {
    const proxy = new Mesh(this.geometry, this.material);
    proxy.matrixWorld.copy(this.matrixWorld);
    proxy.matrixWorldAutoUpdate = proxy.matrixAutoUpdate = false;
    proxy.frustumCulled = false;
    const scene = new Scene();
    scene.matrixWorldAutoUpdate = false;
    scene.add(proxy);
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
    // three.js asks once which uniforms there are.
    const values = { ...fieldUniforms(opened), ...viewUniforms(opened.metadata, NOWHERE, { finest: 0, fixedLevel: null, keepsRange: false }) };
    const samplers = SAMPLERS.map((name) => [name, { value: name === "u_weights" ? new Texture() : new Data3DTexture() }]);
    const uniforms: RawShaderMaterial["uniforms"] = Object.fromEntries([...samplers, ...Object.entries(values).map(([name, value]) => [name, { value }])]);
    this.material = new FieldMaterial(fragmentShader(opened), uniforms, (material, renderer, camera, object) => this.prepare(material, renderer, camera, object));
  }

  /**
   * Before every draw: levels that wait go to the device, uniforms follow the camera. `object` is this one, or a plain mesh
   * that somebody has given its material and geometry.
   */
  private prepare(material: FieldMaterial, renderer: WebGLRenderer, camera: Camera, object: Mesh): void {
    const { geometry } = object;
    geometry.setDrawRange(...NOTHING);
    const target = renderer.getRenderTarget();
    if (attachments(target) > 1) return this.refuse("A field is not drawn into a target of several color attachments.", REMEDY.attachments);
    this.upload(renderer);
    const { file } = this.streamed;
    const device = this.streamed.on(renderer.getContext() as WebGL2RenderingContext);
    const shown = this.sampled ?? { output: this.showLevels ? OUTPUT.levels : OUTPUT.color };
    const finest = this.sampled?.finest ?? device?.finest ?? null;
    if (!file || !device?.textures || finest === null) return;
    for (const [name, handle] of Object.entries(device.textures)) {
      // A renderer, or one whose device came back, has not seen what it did not make.
      const known = renderer.properties.get(material.uniforms[name].value) as { __webglTexture?: WebGLTexture; __webglInit?: boolean };
      [known.__webglTexture, known.__webglInit] = [handle, true];
    }
    geometry.setDrawRange(0, Infinity);
    if (!this.sampled) this.renderer = renderer;
    const { keepsRange, fixedLevel } = this;
    const view = viewOf(camera, object.matrixWorld.elements, renderer);
    const uniforms = viewUniforms(file.metadata, view, { finest, fixedLevel, keepsRange, ...shown });
    if (!this.sampled) this.streamed.look(view);
    for (const [name, value] of Object.entries(uniforms)) material.uniforms[name].value = value;
    material.uniformsNeedUpdate = true;
  }

  /** Tells once why the field is not drawn: an error would end the whole scene's picture. */
  private refuse(message: string, remedy: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.error(`${message} ${remedy}`);
    this.dispatchEvent({ type: "failed", error: new FieldError(message, remedy) });
  }
}

/** What a mesh is drawn with. Whoever gets the material and the geometry of a field draws that field. */
class FieldMaterial extends RawShaderMaterial {
  constructor(
    fragment: string,
    uniforms: RawShaderMaterial["uniforms"],
    private readonly prepare: (material: FieldMaterial, renderer: WebGLRenderer, camera: Camera, object: Mesh) => void,
  ) {
    // Raw, so that every target is drawn by the same program.
    super({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: fragment,
      uniforms,
      // Rays are entered by the far sides of the box, so that a camera may stand in it.
      side: BackSide,
      transparent: true,
      premultipliedAlpha: true,
    });
  }

  override onBeforeRender(renderer: WebGLRenderer, _scene: Scene, camera: Camera, _geometry: BufferGeometry, object: Object3D): void {
    this.prepare(this, renderer, camera, object as Mesh);
  }

  override clone(): this {
    const uniforms = Object.fromEntries(Object.entries(this.uniforms).map(([name, { value }]) => [name, { value }]));
    return new FieldMaterial(this.fragmentShader, uniforms, this.prepare) as this;
  }
}

/** @ts-ignore where react-three-fiber is not installed, nothing is said of it. */
declare module "@react-three/fiber" {
  interface ThreeElements {
    /** @ts-ignore as above; after `extend({ RadianceField })` */
    radianceField: import("@react-three/fiber").ThreeElement<typeof RadianceField>;
  }
}
