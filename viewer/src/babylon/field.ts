/** A baked radiance field as a mesh of a Babylon.js scene. */

import { Constants } from "@babylonjs/core/Engines/constants.js";
import type { Engine } from "@babylonjs/core/Engines/engine.js";
import "@babylonjs/core/Engines/Extensions/engine.renderTarget.js";
import { Material } from "@babylonjs/core/Materials/material.js";
import { ShaderMaterial } from "@babylonjs/core/Materials/shaderMaterial.js";
import { BaseTexture } from "@babylonjs/core/Materials/Textures/baseTexture.js";
import type { InternalTexture } from "@babylonjs/core/Materials/Textures/internalTexture.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Matrix, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { PickingInfo } from "@babylonjs/core/Collisions/pickingInfo.js";
import type { Ray, TrianglePickingPredicate } from "@babylonjs/core/Culling/ray.js";
import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
import type { InstancedMesh } from "@babylonjs/core/Meshes/instancedMesh.js";
import { Mesh, type MeshCloneOptions } from "@babylonjs/core/Meshes/mesh.js";
import { VertexData } from "@babylonjs/core/Meshes/mesh.vertexData.js";
import type { SubMesh } from "@babylonjs/core/Meshes/subMesh.js";
import { Observable } from "@babylonjs/core/Misc/observable.js";
import { Node } from "@babylonjs/core/node.js";
import type { Nullable } from "@babylonjs/core/types.js";
import type { Scene } from "@babylonjs/core/scene.js";
import { EXTENSION } from "../asset.js";
import { FieldError, REMEDY } from "../errors.js";
import type { Metadata } from "../format/metadata.js";
import { outerBounds } from "../format/parts.js";
import type { Opened } from "../load/loader.js";
import type { Source } from "../load/source.js";
import { inverse, lookingAlong, product } from "../render/matrices.js";
import { pickedPoint, pickedProjection, RAY_PROJECTION, type Statistics, statisticsOf } from "../render/measures.js";
import { OUTPUT } from "../render/shader.js";
import type { DeviceTexture } from "../render/textureDevice.js";
import type { Textures } from "../render/textures.js";
import { fieldUniforms, logarithmOf, NO_LOGARITHM, NOWHERE, type Shown, type Uniforms, type View, viewUniforms } from "../render/uniforms.js";
import type { Budget, FieldEvents, FieldOptions, Owner } from "../fieldOptions.js";
import { StreamedField } from "../streamed.js";
import { type Drawing, drawingOf } from "./engines.js";

/** The sides of a box: corners by their bits (x, y, z), each side counterclockwise as seen from outside. */
const SIDES = [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]];
/** Converts a left-handed world or camera to a right-handed one, and back. */
const SAME = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const MIRROR_X = SAME.map((value, at) => (at === 0 ? -1 : value));
const MIRROR_Z = SAME.map((value, at) => (at === 10 ? -1 : value));

/**
 * Marches rays through a baked field, inside its box. Local axes are those of training, z up. In a left-handed scene,
 * the field is mirrored along x before its own transform, as Babylon.js does with glTF assets, so that it looks right.
 */
export class RadianceField extends Mesh {
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
  readonly onOpenedObservable = new Observable<FieldEvents["opened"]>();
  readonly onProgressObservable = new Observable<FieldEvents["progress"]>();
  /** Notifies that the field must be redrawn. */
  readonly onChangeObservable = new Observable<FieldEvents["change"]>();
  readonly onDoneObservable = new Observable<FieldEvents["done"]>();
  readonly onFailedObservable = new Observable<FieldEvents["failed"]>();
  private readonly drawing: Drawing;
  private readonly streamed: StreamedField;
  private readonly owner: Owner;
  private uniforms: Uniforms = {};
  /** The only material that draws the field, even if other code replaces the material of the mesh. */
  private own: ShaderMaterial | null = null;
  /** The view and the output to draw instead of the scene camera's picture; null for pictures. */
  private sampled: { view: View; shown: Partial<Shown> } | null = null;
  /** Messages about this field that were already shown; each is shown once. */
  private readonly told = new Set<string>();
  /** Textures of the material, and the device handles that they wrap. */
  private wrapped: { textures: BaseTexture[]; handles: Textures } | null = null;

  /**
   * Loads `source`, the address of a container or its bytes. Given another field, shares its loaded data and its device
   * memory. The field is drawn as soon as the coarsest levels are loaded.
   */
  constructor(source: Source | RadianceField, scene: Scene, options?: FieldOptions) {
    const drawing = drawingOf(scene);
    super(EXTENSION, scene);
    this.drawing = drawing;
    if (!scene.useRightHandedSystem) this.setPreTransformMatrix(Matrix.Scaling(-1, 1, 1));
    const observables: { [Kind in keyof FieldEvents]: Observable<FieldEvents[Kind]> } = {
      opened: this.onOpenedObservable,
      progress: this.onProgressObservable,
      change: this.onChangeObservable,
      done: this.onDoneObservable,
      failed: this.onFailedObservable,
    };
    this.owner = {
      begin: (opened) => this.begin(opened, scene),
      tell: (kind, event) => observables[kind].notifyObservers(event),
    };
    this.streamed = source instanceof RadianceField ? source.streamed : new StreamedField(source, options);
    ({ opened: this.opened, finished: this.finished } = this.streamed);
    this.streamed.join(this.owner);
  }

  /** Another mesh of the same field, which is loaded and stored only once. */
  override clone(name = `Clone of ${this.name}`, parent: Nullable<Node> | MeshCloneOptions = null, doNotCloneChildren?: boolean): RadianceField {
    const options = parent instanceof Node || !parent ? { parent, doNotCloneChildren } : parent;
    const copy = new RadianceField(this, this.getScene());
    [copy.name, copy.id, copy.metadata] = [name, name, this.metadata];
    copy.parent = options.parent ?? this.parent;
    copy.setPreTransformMatrix(this.getPivotMatrix().clone());
    copy.position.copyFrom(this.position);
    copy.rotation.copyFrom(this.rotation);
    copy.rotationQuaternion = this.rotationQuaternion?.clone() ?? null;
    copy.scaling.copyFrom(this.scaling);
    copy.setEnabled(this.isEnabled(false));
    [copy.isVisible, copy.isPickable, copy.layerMask, copy.renderingGroupId] = [this.isVisible, this.isPickable, this.layerMask, this.renderingGroupId];
    [copy.showLevels, copy.fixedLevel, copy.keepsRange] = [this.showLevels, this.fixedLevel, this.keepsRange];
    if (!options.doNotCloneChildren) for (const child of this.getChildTransformNodes(true)) child.clone(`${name}.${child.name}`, copy);
    return copy;
  }

  /** As `clone`: the device draws one box per field, so instances would save nothing. */
  override createInstance(name: string): InstancedMesh {
    return this.clone(name, null, true) as unknown as InstancedMesh;
  }

  /** Number of bytes received. */
  get arrived(): number {
    return this.streamed.arrived;
  }

  /** Contents of the file and how it was transferred; null until it is opened. */
  get file(): Pick<Opened, "metadata" | "fileBytes" | "available" | "prefixes" | "transfer" | "plan"> | null {
    return this.streamed.file;
  }

  /** The finest level shown; null before the first picture. */
  get finest(): number | null {
    return this.streamed.on(this.drawing.device)?.finest ?? null;
  }

  /** Device memory of the field, and how many of its blocks fit; null until it is opened. */
  get budget(): Budget | null {
    return this.streamed.budget;
  }

  /** The box of the whole field in local axes. */
  get bounds(): { min: Vector3; max: Vector3 } {
    const { min, max } = this.file ? outerBounds(this.file.metadata) : { min: [0, 0, 0], max: [0, 0, 0] };
    return { min: Vector3.FromArray(min), max: Vector3.FromArray(max) };
  }

  /** Whether loaded levels wait for upload with the next pictures. */
  get waiting(): boolean {
    return this.streamed.waiting;
  }

  /** Whether the bytes of a level, or blocks near the camera, are being decoded. */
  get decoding(): boolean {
    return this.streamed.decoding;
  }

  /**
   * Uploads decoded blocks to the device, for a few milliseconds; every draw does this too. Returns whether the picture
   * has changed.
   */
  upload(): boolean {
    const isChanged = this.streamed.upload(this.drawing.device);
    this.wrap();
    return isChanged;
  }

  override render(subMesh: SubMesh, enableAlphaMode: boolean, effectiveMeshReplacement?: AbstractMesh): this {
    this.upload();
    if (this.own && this.material !== this.own) this.material = this.own;
    const refusal = this.drawing.refusal();
    if (refusal) {
      this.refuse(...refusal);
      return this;
    }
    return this.finest === null || !this.wrapped ? this : super.render(subMesh, enableAlphaMode, effectiveMeshReplacement) as this;
  }

  /** Intersects what pictures show, as `pick` does. Hits nothing before the first picture. */
  override intersects(ray: Ray, fastCheck?: boolean, predicate?: TrianglePickingPredicate, onlyBoundingInfo = false, world = this.getWorldMatrix()): PickingInfo {
    const box = super.intersects(ray, fastCheck, predicate, onlyBoundingInfo, world);
    if (!box.hit || onlyBoundingInfo) return box;
    const scene = this.getScene();
    const right = scene.useRightHandedSystem ? 1 : -1;
    const turned = ({ x, y, z }: Vector3) => [right * x, y, z];
    const origin = Vector3.TransformCoordinates(ray.origin, world);
    const camera = lookingAlong(turned(origin), turned(Vector3.TransformNormal(ray.direction, world).normalize()));
    const place = product(right === 1 ? SAME : MIRROR_X, world.m);
    const found = new PickingInfo();
    if (!this.drawing.readNow) {
      const message = "Rays do not hit fields that WebGPU draws, because its answers come later. Use pickAsync.";
      if (!this.told.has(message)) console.warn(message);
      this.told.add(message);
      return found;
    }
    const point = this.finest === null ? null : this.pointOf({ world: place, camera, projection: RAY_PROJECTION, viewport: [], isLinear: false, depth: [0.5, 0.5], logarithm: NO_LOGARITHM });
    if (!point) return found;
    [found.hit, found.pickedMesh, found.pickedPoint, found.distance] = [true, this, point, Vector3.Distance(origin, point)];
    return found;
  }

  /**
   * Counts the work of a picture with `rows` rows from the scene's camera, using `width` by `height` of its rays.
   * Without `skips`, counts a dense march: every sample between entry and exit, with its colours.
   */
  statistics(width: number, height: number, rows: number, skips = true): Statistics {
    return statisticsOf(this.sample(width, height, this.view(), { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows }));
  }

  /** As `statistics`, also for WebGPU engines. */
  async statisticsAsync(width: number, height: number, rows: number, skips = true): Promise<Statistics> {
    return statisticsOf(await this.sampleAsync(width, height, this.view(), { output: OUTPUT.statistics, skips, halfPixel: (0.5 * height) / rows }));
  }

  /**
   * The world position that the scene's camera shows at `x`, `y`, fractions of the picture's width and height from the
   * top left. Null if the field is nearly transparent there.
   */
  pick(x: number, y: number): Vector3 | null {
    const view = this.view();
    return this.pointOf({ ...view, projection: pickedProjection(view.projection, x, y) });
  }

  /** As `pick`, also for WebGPU engines. */
  async pickAsync(x: number, y: number): Promise<Vector3 | null> {
    const of = this.view();
    const view = { ...of, projection: pickedProjection(of.projection, x, y) };
    return this.pointAt(await this.sampleAsync(1, 1, view, { output: OUTPUT.distance }), view);
  }

  /** The world position shown by a view of one pixel. */
  private pointOf(view: View): Vector3 | null {
    return this.pointAt(this.sample(1, 1, view, { output: OUTPUT.distance }), view);
  }

  private pointAt(pixel: Float32Array, view: View): Vector3 | null {
    const point = pickedPoint(pixel, view.camera, view.projection);
    if (!point) return null;
    if (!this.getScene().useRightHandedSystem) point[0] *= -1;
    return Vector3.FromArray(point);
  }

  /** Stops drawing the field. With the last mesh that shares it, loading ends and the device memory is freed. */
  override dispose(doNotRecurse?: boolean): void {
    this.streamed.leave(this.owner);
    this.wrap(null);
    this.own?.dispose();
    super.dispose(doNotRecurse);
  }

  /** Reports once why the field is not drawn. */
  private refuse(message: string, remedy: string): void {
    if (this.told.has(message)) return;
    this.told.add(message);
    console.error(`${message} ${remedy}`);
    this.onFailedObservable.notifyObservers({ error: new FieldError(message, remedy) });
  }

  /** Builds everything that does not depend on levels. */
  private begin(opened: Opened, scene: Scene): void {
    const { min, max } = outerBounds(opened.metadata);
    const box = new VertexData();
    box.positions = SAME.slice(0, 8).flatMap((_, corner) => min.map((min, axis) => ((corner >> axis) & 1 ? max[axis] : min)));
    box.indices = SIDES.flatMap(([a, b, c, d]) => [a, b, c, a, c, d]);
    box.applyToMesh(this);
    this.uniforms = fieldUniforms(opened);
    const example = { ...this.uniforms, ...viewUniforms(opened.metadata, NOWHERE, { finest: 0, fixedLevel: null, keepsRange: false }) };
    const { source, options, set } = this.drawing.shader(opened, example);
    const material = new ShaderMaterial(EXTENSION, scene, source, { attributes: ["position"], uniforms: [], ...options, needAlphaBlending: true });
    material.alphaMode = Constants.ALPHA_PREMULTIPLIED_PORTERDUFF;
    material.forceDepthWrite = true;
    // Rays are entered by the far sides of the box, so that a camera may stand in it.
    material.cullBackFaces = false;
    material.sideOrientation = scene.useRightHandedSystem ? Material.CounterClockWiseSideOrientation : Material.ClockWiseSideOrientation;
    material.onBindObservable.add(() => set(material.getEffect()!, this.bound(scene, opened.metadata)));
    this.own = this.material = material;
  }

  /** Updates uniforms from the camera, before every draw. */
  private bound(scene: Scene, metadata: Metadata): Uniforms {
    const { finest, fixedLevel, keepsRange } = this;
    const output = this.showLevels ? OUTPUT.levels : OUTPUT.color;
    const view = this.sampled?.view ?? viewOf(scene, this.getWorldMatrix().m, this.own!.useLogarithmicDepth, this.drawing.depth);
    const shown = { finest: finest!, fixedLevel, keepsRange, output, ...this.sampled?.shown };
    if (!this.sampled) this.streamed.look(view);
    return { ...this.uniforms, ...viewUniforms(metadata, view, shown) };
  }

  /** The view of the scene's camera. */
  private view(): View {
    const scene = this.getScene();
    scene.updateTransformMatrix(true);
    return viewOf(scene, this.computeWorldMatrix(true).m, false, this.drawing.depth);
  }

  /** One kind of output, four numbers per pixel; all 0 where nothing is drawn. */
  private sample(width: number, height: number, view: View, shown: Partial<Shown>): Float32Array {
    const { readNow } = this.drawing;
    if (!readNow) throw new FieldError("Engines for WebGPU answer later, not at once.", REMEDY.later);
    return this.drawAside(width, height, view, shown, () => readNow(width, height));
  }

  private async sampleAsync(width: number, height: number, view: View, shown: Partial<Shown>): Promise<Float32Array> {
    if (this.drawing.readNow) return this.sample(width, height, view, shown);
    return this.drawAside(width, height, view, shown, (texture) => this.drawing.read(texture, width, height));
  }

  /** Draws only the field into a separate target and reads it. */
  private drawAside<T>(width: number, height: number, view: View, shown: Partial<Shown>, read: (texture: InternalTexture) => T): T {
    const engine = this.getEngine() as Engine;
    const options = { type: Constants.TEXTURETYPE_FLOAT, samplingMode: Constants.TEXTURE_NEAREST_NEAREST, generateDepthBuffer: true, generateMipMaps: false };
    const target = engine.createRenderTargetTexture({ width, height }, options);
    const alphaMode = engine.getAlphaMode();
    this.sampled = { view: { ...view, viewport: [0, 0, width, height] }, shown };
    try {
      engine.bindFramebuffer(target);
      engine.clear(new Color4(0, 0, 0, 0), true, true);
      engine.setAlphaMode(Constants.ALPHA_DISABLE);
      if (this.subMeshes?.length) this.render(this.subMeshes[0], false);
      return read(target.texture!);
    } finally {
      this.sampled = null;
      engine.setAlphaMode(alphaMode);
      engine.unBindFramebuffer(target);
      target.dispose();
    }
  }

  /** Wraps the textures of the device for Babylon.js. */
  private wrap(handles = this.streamed.on(this.drawing.device)?.textures ?? null): void {
    if (handles === (this.wrapped?.handles ?? null)) return;
    for (const texture of this.wrapped?.textures ?? []) {
      // Handles are freed by who made them, and may be those of a lost device.
      texture.getInternalTexture()?._hardwareTexture?.reset();
      texture.dispose();
    }
    this.wrapped = handles && { handles, textures: Object.entries(handles).map(([name, texture]) => this.wrapOne(name, texture)) };
  }

  private wrapOne(name: string, made: DeviceTexture): BaseTexture {
    const internal = this.drawing.wrap(made);
    internal.is3D = !made.flat;
    internal.isReady = true;
    const texture = new BaseTexture(this.getEngine(), internal);
    texture.wrapU = texture.wrapV = texture.wrapR = Constants.TEXTURE_CLAMP_ADDRESSMODE;
    texture.anisotropicFilteringLevel = 1;
    this.own!.setTexture(name, texture);
    return texture;
  }
}

/** The view of a scene. */
function viewOf(scene: Scene, world: ArrayLike<number>, isLogarithmic: boolean, depth: [number, number]): View {
  const engine = scene.getEngine();
  const [width, height] = [engine.getRenderWidth(), engine.getRenderHeight()];
  const { x, y, width: wide, height: high } = engine.currentViewport ?? { x: 0, y: 0, width: 1, height: 1 };
  const [mirrorWorld, mirrorCamera] = scene.useRightHandedSystem ? [SAME, SAME] : [MIRROR_X, MIRROR_Z];
  return {
    world: product(mirrorWorld, world),
    camera: product(mirrorWorld, product(inverse(scene.getViewMatrix().m), mirrorCamera)),
    projection: product(scene.getProjectionMatrix().m, mirrorCamera),
    viewport: [x * width, y * height, wide * width, high * height],
    // Then a pass of its own makes the picture's values display-referred.
    isLinear: scene.imageProcessingConfiguration.applyByPostProcess,
    depth,
    logarithm: isLogarithmic ? logarithmOf(scene.activeCamera!.maxZ) : NO_LOGARITHM,
  };
}
