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
  Matrix4,
  Mesh,
  NoBlending,
  NormalBlending,
  type Object3D,
  type Object3DEventMap,
  PerspectiveCamera,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  SRGBColorSpace,
  Texture,
  Vector3,
  Vector4,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import type { Metadata } from "../format/metadata.js";
import type { Opened } from "../load/loader.js";
import type { Source } from "../load/source.js";
import { pickedPoint, pickedProjection, type Statistics, statisticsOf } from "../render/measures.js";
import { fragmentShader, OUTPUT, VERTEX } from "../render/shader.js";
import { SAMPLERS } from "../render/textures.js";
import { fieldUniforms, type Shown, type View, viewUniforms } from "../render/uniforms.js";
import { type FieldEvents, StreamedField } from "../streamed.js";

/** What `RadianceField` tells, beside what all objects of three.js tell. */
export interface RadianceFieldEventMap extends Object3DEventMap, FieldEvents {}

/** A range that three.js does not draw. It does draw one of no length, for which textures have to fit, too. */
const NOTHING = [0, -1] as const;

/**
 * Marches rays through a baked field, in the box that the field spans. Its local axes are those of training, z up:
 * a node of a scene whose y is up turns it by a quarter about x. Drawn with perspective cameras.
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
  /** Whether rays keep to the near and far of the training cameras, as the reference renderer does. */
  keepsRange = true;
  private readonly streamed: StreamedField;

  /** Loads `source`, the address of a container or its bytes. Draws as soon as the coarsest levels are there. */
  constructor(source: Source) {
    super(new BoxGeometry(), new ShaderMaterial());
    this.geometry.setDrawRange(...NOTHING);
    this.name = "MIPVOG_radiance_field";
    this.streamed = new StreamedField(source, {
      begin: (opened) => this.begin(opened),
      tell: (type, event) => this.dispatchEvent({ type, ...event } as never),
    });
    ({ opened: this.opened, finished: this.finished } = this.streamed);
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

  /** The part of the box, in local axes, where something is to be seen; all of it before the first level. */
  get visibleBounds(): Box3 {
    const [min, max] = this.streamed.visible;
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** The box in local axes. */
  get bounds(): Box3 {
    const { min, max } = this.metadata?.bounds ?? { min: [0, 0, 0], max: [0, 0, 0] };
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** Ends loading and frees the device's memory; the field is not drawn any more. */
  dispose(): void {
    this.streamed.dispose();
    this.visible = false;
    this.geometry.dispose();
    this.material.dispose();
  }

  override onBeforeRender = (renderer: WebGLRenderer, _scene: Object3D, camera: Camera): void => {
    this.prepare(renderer, camera, { output: this.showLevels ? OUTPUT.levels : OUTPUT.color });
  };

  /**
   * Counts what a picture of `rows` rows takes, from `width` by `height` rays of it. Without `skips` as a dense march
   * would: every sample between entry and exit, with its colours.
   */
  statistics(renderer: WebGLRenderer, camera: PerspectiveCamera, width: number, height: number, rows: number, skips = true): Statistics {
    return statisticsOf(this.sample(renderer, camera, width, height, { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows }));
  }

  /**
   * The world's point that a picture shows at `x`, `y`, shares of its width and height from the top left; null where the
   * field is next to invisible.
   */
  pick(renderer: WebGLRenderer, camera: PerspectiveCamera, x: number, y: number): Vector3 | null {
    const one = new PerspectiveCamera();
    one.matrixWorldAutoUpdate = one.matrixAutoUpdate = false;
    one.matrixWorld.copy(camera.matrixWorld);
    one.matrixWorldInverse.copy(camera.matrixWorld).invert();
    one.projectionMatrix.fromArray(pickedProjection(camera.projectionMatrix.elements, x, y));
    const pixel = this.sample(renderer, one, 1, 1, { output: OUTPUT.distance });
    const point = pickedPoint(pixel, one.matrixWorld.elements, one.projectionMatrix.elements);
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
  private sample(renderer: WebGLRenderer, camera: PerspectiveCamera, width: number, height: number, shown: Partial<Shown>): Float32Array {
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
  private drawInto(target: WebGLRenderTarget, renderer: WebGLRenderer, camera: PerspectiveCamera, shown: Partial<Shown>): void {
    const proxy = new Mesh(this.geometry, this.material);
    proxy.matrixWorld.copy(this.matrixWorld);
    proxy.matrixWorldAutoUpdate = proxy.matrixAutoUpdate = false;
    proxy.frustumCulled = false;
    proxy.onBeforeRender = (renderer, _scene, camera) => {
      this.prepare(renderer, camera, shown);
    };
    const scene = new Scene();
    scene.matrixWorldAutoUpdate = false;
    scene.add(proxy);
    const [before, alpha] = [renderer.getRenderTarget(), renderer.getClearAlpha()];
    renderer.setRenderTarget(target);
    renderer.setClearAlpha(0);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(before);
    renderer.setClearAlpha(alpha);
  }

  /** Builds what does not depend on levels. */
  private begin(opened: Opened): void {
    const { min, max } = opened.metadata.bounds;
    const size = min.map((min, axis) => max[axis] - min);
    this.geometry.dispose();
    this.geometry = new BoxGeometry(size[0], size[1], size[2]).translate(min[0] + size[0] / 2, min[1] + size[1] / 2, min[2] + size[2] / 2);
    this.geometry.setDrawRange(...NOTHING);
    this.material.dispose();
    // three.js asks once which uniforms there are.
    const values = { ...fieldUniforms(opened), ...viewUniforms(opened.metadata, NOWHERE, { finest: 0, fixedLevel: null, keepsRange: true }) };
    const samplers = SAMPLERS.map((name) => [name, { value: name === "u_weights" ? new Texture() : new Data3DTexture() }]);
    // Raw, so that every target is drawn by the same program.
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: fragmentShader(opened),
      uniforms: Object.fromEntries([...samplers, ...Object.entries(values).map(([name, value]) => [name, { value }])]),
      // Rays are entered by the far sides of the box, so that a camera may stand in it.
      side: BackSide,
      transparent: true,
      premultipliedAlpha: true,
    });
  }

  /** Before every draw: levels that wait go to the device, uniforms follow the camera. */
  private prepare(renderer: WebGLRenderer, camera: Camera, shown: Partial<Shown>): void {
    this.geometry.setDrawRange(...NOTHING);
    if (!(camera as PerspectiveCamera).isPerspectiveCamera) return;
    this.upload(renderer);
    const { file, textures } = this.streamed;
    const finest = shown.finest ?? this.streamed.finest;
    if (!file || !textures || finest === null) return;
    for (const [name, handle] of Object.entries(textures)) {
      // A renderer, or one whose device came back, has not seen what it did not make.
      const known = renderer.properties.get(this.material.uniforms[name].value) as { __webglTexture?: WebGLTexture; __webglInit?: boolean };
      [known.__webglTexture, known.__webglInit] = [handle, true];
    }
    this.geometry.setDrawRange(0, Infinity);
    const { keepsRange, fixedLevel, matrixWorld } = this;
    const uniforms = viewUniforms(file.metadata, viewOf(camera as PerspectiveCamera, matrixWorld.elements, renderer), { finest, fixedLevel, keepsRange, ...shown });
    for (const [name, value] of Object.entries(uniforms)) this.material.uniforms[name].value = value;
    this.material.uniformsNeedUpdate = true;
  }
}

/** Before the first picture. */
const PLACE = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const NOWHERE: View = { world: PLACE, camera: PLACE, projection: PLACE, viewport: [0, 0, 1, 1], isLinear: false, depth: [0, 0] };

/** Where a renderer takes its picture. */
function viewOf(camera: PerspectiveCamera, world: number[], renderer: WebGLRenderer): View {
  // An eye of a headset has a part of the picture.
  const { viewport: own } = camera as PerspectiveCamera & { viewport?: Vector4 };
  const viewport = own ?? renderer.getCurrentViewport(new Vector4());
  const { width, height } = renderer.domElement;
  // Named `reverseDepthBuffer` before release 182.
  const { reversedDepthBuffer, reverseDepthBuffer } = renderer.capabilities as typeof renderer.capabilities & { reverseDepthBuffer?: boolean };
  return {
    world,
    camera: camera.matrixWorld.elements,
    projection: camera.projectionMatrix.elements,
    // Unknown to renderers whose size was never set.
    viewport: viewport.z === 0 ? [0, 0, width, height] : viewport.toArray(),
    isLinear: renderer.getRenderTarget() !== null || renderer.outputColorSpace !== SRGBColorSpace,
    depth: (reversedDepthBuffer ?? reverseDepthBuffer) ? [1, 0] : [0.5, 0.5],
  };
}
