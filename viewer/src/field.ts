/** A baked radiance field as an object of a three.js scene. */

import {
  BackSide,
  Box3,
  BoxGeometry,
  type BufferGeometry,
  type Camera,
  FloatType,
  GLSL3,
  Mesh,
  NoBlending,
  NormalBlending,
  type Object3D,
  type Object3DEventMap,
  type PerspectiveCamera,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  Vector3,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { startDecoder } from "./decoder.js";
import { deviceLimits } from "./device.js";
import { FieldError, REMEDY } from "./errors.js";
import type { Metadata } from "./format/metadata.js";
import type { Opened } from "./load/loader.js";
import type { Reply, Request } from "./load/messages.js";
import type { Source } from "./load/source.js";
import { Atlas } from "./render/atlas.js";
import { WIDEST_LAYER } from "./render/network.js";
import { defines, fragmentShader, OUTPUT, VERTEX } from "./render/shader.js";
import { BEYOND, fieldUniforms, type Uniforms, viewUniforms } from "./render/uniforms.js";

/** What `RadianceField` tells, beside what all objects of three.js tell. */
export interface RadianceFieldEventMap extends Object3DEventMap {
  /** Header, metadata and network are there. */
  opened: { metadata: Metadata };
  /** More bytes have arrived. */
  progress: { arrived: number };
  /** The picture has changed: a level came, or a part of one. Draw again. */
  change: {};
  /** All levels are there. */
  done: {};
  /** Loading ended with an error; what was there before keeps being shown. */
  failed: { error: FieldError };
}

/** Pixels along a picture of which one is picked, and the opacity that it must have. */
const [PICKED, LEAST_PICKED] = [1024, 0.1];

/** Files from this size on are decoded by several workers, and by how many at most. */
const [HELPED_BYTES, MOST_HELPERS] = [1 << 20, 16];

/** What a picture took, as means over the rays that meet the box. */
export interface Statistics {
  /** Rays that meet the box. */
  rays: number;
  samplesPerRay: number;
  fetchesPerRay: number;
  /** Samples between entry and exit, looked at or not. */
  stepsPerRay: number;
}

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
  /** Bytes that have arrived. */
  arrived = 0;
  private content: { opened: Opened; atlas: Atlas; uniforms: Uniforms } | null = null;
  private readonly worker: Worker;
  /** Workers that help the first to decode. */
  private readonly helpers: Worker[] = [];
  /** How often levels were asked for again. */
  private round = 0;
  /** Breaks the promises that are not kept yet. */
  private readonly reject: (error: FieldError) => void;

  /** Loads `source`, the address of a container or its bytes. Draws as soon as the coarsest levels are there. */
  constructor(source: Source) {
    super(new BoxGeometry(), new ShaderMaterial());
    this.geometry.setDrawRange(0, 0);
    this.name = "MIPVOG_radiance_field";
    const device = deviceLimits();
    this.worker = startDecoder();
    const opened = promise<Metadata>();
    const finished = promise<void>();
    [this.opened, this.finished] = [opened.promise, finished.promise];
    this.reject = (error) => {
      opened.reject(error);
      finished.reject(error);
    };
    this.worker.onerror = () => this.fail(new FieldError("The decoder could not be started.", REMEDY.decoder));
    this.worker.onmessage = ({ data }: MessageEvent<Reply>) => {
      try {
        if (data.kind === "failed") {
          // Levels that came before are shown, and may have to come again.
          if (!this.content) this.terminate();
          this.fail(new FieldError(data.message, data.remedy));
        } else if (data.kind === "opened") {
          this.begin(data.opened);
          if (data.opened.fileBytes >= HELPED_BYTES) this.startHelpers();
          opened.resolve(data.opened.metadata);
          this.dispatchEvent({ type: "opened", metadata: data.opened.metadata });
        } else if (data.kind === "progress") {
          this.arrived = data.arrived;
          this.dispatchEvent({ type: "progress", arrived: data.arrived });
        } else if (data.kind === "part") {
          if (data.round === this.round) this.content?.atlas.add(data.part);
        } else if (data.kind === "entry") {
          if (data.round === this.round) this.content?.atlas.finish(data.entry);
          this.dispatchEvent({ type: "change" });
        } else {
          finished.resolve();
          this.dispatchEvent({ type: "done" });
        }
      } catch (error) {
        this.terminate();
        this.fail(error instanceof FieldError ? error : new FieldError(String(error)));
      }
    };
    // A blob's bytes are not copied on their way to the worker.
    const own = typeof source === "string" ? new URL(source, document.baseURI).href : source instanceof Blob ? source : new Blob([source]);
    this.ask({ kind: "load", source: own, device });
  }

  /** What is in the file; null until it is opened. */
  get metadata(): Metadata | null {
    return this.content?.opened.metadata ?? null;
  }

  /** How the file came and what of it the device holds; null until it is opened. */
  get file(): Pick<Opened, "fileBytes" | "available" | "prefixes" | "transfer" | "plan"> | null {
    return this.content?.opened ?? null;
  }

  /**
   * Brings decoded blocks to the device, for a few milliseconds; every draw does this as well. Whether the picture has
   * changed.
   */
  upload(renderer: WebGLRenderer): boolean {
    if (!this.content) return false;
    const { atlas } = this.content;
    const before = atlas.live.size;
    try {
      if (!atlas.upload(renderer)) {
        this.round++;
        this.ask({ kind: "again" });
      }
    } catch (error) {
      if (!(error instanceof FieldError)) throw error;
      // Its textures go when the draw, whose material names them, is over.
      this.content = null;
      queueMicrotask(() => {
        atlas.dispose();
        this.dispose();
      });
      this.fail(error);
      return false;
    }
    const isChanged = atlas.live.size !== before;
    if (atlas.waiting || isChanged) this.dispatchEvent({ type: "change" });
    return isChanged;
  }

  /** The finest level that is shown; null before the first picture. */
  get finest(): number | null {
    return this.content?.atlas.finest ?? null;
  }

  /** Whether levels have come that the next pictures will bring to the device. */
  get waiting(): boolean {
    return this.content?.atlas.waiting ?? false;
  }

  /** The part of the box, in local axes, where something is to be seen; all of it before the first level. */
  get visibleBounds(): Box3 {
    const { min, max } = this.bounds;
    const [low, high] = this.content?.atlas.occupied ?? [[0, 0, 0], [1, 1, 1]];
    const at = (share: number[]) => new Vector3(...share).multiply(max.clone().sub(min)).add(min);
    return new Box3(at(low), at(high));
  }

  /** The box in local axes. */
  get bounds(): Box3 {
    const { min, max } = this.metadata?.bounds ?? { min: [0, 0, 0], max: [0, 0, 0] };
    return new Box3(new Vector3(...min), new Vector3(...max));
  }

  /** Ends loading and frees the device's memory; the field is not drawn any more. */
  dispose(): void {
    this.terminate();
    this.reject(new FieldError("The field was given up before all of it was there.", REMEDY.again));
    this.visible = false;
    this.content?.atlas.dispose();
    this.content = null;
    this.geometry.dispose();
    this.material.dispose();
  }

  override onBeforeRender = (renderer: WebGLRenderer, _scene: Object3D, camera: Camera): void => {
    this.prepare(renderer, camera, this.showLevels ? OUTPUT.levels : OUTPUT.color, true, 0.5);
  };

  /**
   * Counts what a picture of `rows` rows takes, from `width` by `height` rays of it. Without `skips` as a dense march
   * would: every sample between entry and exit, with its colours.
   */
  statistics(renderer: WebGLRenderer, camera: PerspectiveCamera, width: number, height: number, rows: number, skips = true): Statistics {
    const pixels = this.sample(renderer, camera, width, height, OUTPUT.statistics, skips, (0.5 * height) / rows);
    const sums = [0, 0, 0, 0];
    for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] === 1) for (let j = 0; j < 4; j++) sums[j] += pixels[i + j];
    const [samples, fetches, steps, rays] = sums;
    const mean = (sum: number) => sum / Math.max(rays, 1);
    return { rays, samplesPerRay: mean(samples), fetchesPerRay: mean(fetches), stepsPerRay: mean(steps) };
  }

  /**
   * The world's point that a picture shows at `x`, `y`, shares of its width and height from the top left; null where the
   * field is next to invisible.
   */
  pick(renderer: WebGLRenderer, camera: PerspectiveCamera, x: number, y: number): Vector3 | null {
    // A picture of one pixel, of those of one that is fine enough.
    const one = camera.clone();
    one.setViewOffset(PICKED, PICKED, x * PICKED - 0.5, y * PICKED - 0.5, 1, 1);
    one.updateMatrixWorld(true);
    const [distance, opacity] = this.sample(renderer, one, 1, 1, OUTPUT.distance, true, 0.5);
    if (!(opacity > LEAST_PICKED)) return null;
    const direction = new Vector3(0, 0, 0.5).applyMatrix4(one.projectionMatrixInverse);
    return direction.multiplyScalar(-distance / direction.z).applyMatrix4(one.matrixWorld);
  }

  /** Four numbers a pixel of one kind of output. */
  private sample(renderer: WebGLRenderer, camera: PerspectiveCamera, width: number, height: number, output: number, skips: boolean, halfPixel: number): Float32Array {
    const target = new WebGLRenderTarget(width, height, { type: FloatType, depthBuffer: true });
    const proxy = new Mesh(this.geometry, this.material);
    proxy.matrixWorld.copy(this.matrixWorld);
    proxy.matrixWorldAutoUpdate = proxy.matrixAutoUpdate = false;
    proxy.frustumCulled = false;
    proxy.onBeforeRender = (renderer, _scene, camera) => {
      this.prepare(renderer, camera, output, skips, halfPixel);
    };
    const scene = new Scene();
    scene.matrixWorldAutoUpdate = false;
    scene.add(proxy);
    const [before, alpha] = [renderer.getRenderTarget(), renderer.getClearAlpha()];
    this.material.blending = NoBlending;
    renderer.setRenderTarget(target);
    renderer.setClearAlpha(0);
    renderer.clear();
    renderer.render(scene, camera);
    const pixels = new Float32Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    renderer.setRenderTarget(before);
    renderer.setClearAlpha(alpha);
    this.material.blending = NormalBlending;
    target.dispose();
    return pixels;
  }

  /** Builds what does not depend on levels. */
  private begin(opened: Opened): void {
    const { metadata, network, plan } = opened;
    const widest = Math.max(0, ...network.flatMap((layer) => [layer.inputs, layer.outputs]));
    if (widest > WIDEST_LAYER) throw new FieldError(`The network has a layer of ${widest} values; this viewer takes ${WIDEST_LAYER}.`);
    const { min, max } = metadata.bounds;
    const size = min.map((min, axis) => max[axis] - min);
    this.geometry.dispose();
    this.geometry = new BoxGeometry(size[0], size[1], size[2]).translate(min[0] + size[0] / 2, min[1] + size[1] / 2, min[2] + size[2] / 2);
    this.geometry.setDrawRange(0, 0);
    const atlas = new Atlas(opened);
    const uniforms = fieldUniforms(opened, atlas);
    this.material.dispose();
    // Raw, so that every target is drawn by the same program.
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: fragmentShader(metadata, network),
      defines: defines(metadata, plan.quads, network),
      uniforms,
      // Rays are entered by the far sides of the box, so that a camera may stand in it.
      side: BackSide,
      transparent: true,
      premultipliedAlpha: true,
    });
    this.content = { opened, atlas, uniforms };
  }

  /** Before every draw: levels that wait go to the device, uniforms follow the camera. */
  private prepare(renderer: WebGLRenderer, camera: Camera, output: number, skips: boolean, halfPixel: number): void {
    this.geometry.setDrawRange(0, 0);
    if (!this.content || !(camera as PerspectiveCamera).isPerspectiveCamera) return;
    this.upload(renderer);
    if (!this.content) return;
    const { opened, atlas, uniforms } = this.content;
    const finest = atlas.finest;
    if (finest === null) return;
    this.geometry.setDrawRange(0, Infinity);
    viewUniforms(uniforms, opened.metadata, camera as PerspectiveCamera, this.matrixWorld, renderer);
    uniforms.u_finest.value = finest;
    uniforms.u_fixedLevel.value = this.fixedLevel === null ? -1 : Math.max(finest, this.fixedLevel);
    const { near, far } = opened.metadata.march;
    uniforms.u_range.value.set(this.keepsRange ? near : 0, (this.keepsRange ? far : null) ?? BEYOND);
    uniforms.u_output.value = output;
    uniforms.u_skips.value = skips;
    uniforms.u_halfPixel.value = halfPixel;
    this.material.uniformsNeedUpdate = true;
  }

  /** Starts as many decoders as the device has cores, beside the one that reads. */
  private startHelpers(): void {
    const ports = Array.from({ length: Math.min(MOST_HELPERS, navigator.hardwareConcurrency) }, () => {
      const { port1, port2 } = new MessageChannel();
      const helper = startDecoder();
      helper.onerror = this.worker.onerror;
      this.helpers.push(helper);
      helper.postMessage({ kind: "help", port: port2 } satisfies Request, [port2]);
      return port1;
    });
    this.worker.postMessage({ kind: "crew", ports } satisfies Request, ports);
  }

  private terminate(): void {
    for (const worker of [this.worker, ...this.helpers]) worker.terminate();
  }

  private fail(error: FieldError): void {
    this.reject(error);
    this.dispatchEvent({ type: "failed", error });
  }

  private ask(request: Request): void {
    this.worker.postMessage(request);
  }
}

/** A promise to be kept elsewhere; nobody has to listen to its failure. */
function promise<T>(): { promise: Promise<T>; resolve: (value: T) => void; reject: (error: FieldError) => void } {
  let resolve!: (value: T) => void;
  let reject!: (error: FieldError) => void;
  const made = new Promise<T>((yes, no) => ([resolve, reject] = [yes, no]));
  made.catch(() => {});
  return { promise: made, resolve, reject };
}
