/** Fields in three.js's WebGPURenderer: a node material around one WGSL function. */

import { type ArrayCamera, Data3DTexture, DataTexture, FloatType, type Mesh, NearestFilter, type PerspectiveCamera, type RenderTarget, REVISION, RGBAFormat, RGBAIntegerFormat, type Texture, UnsignedIntType, Vector4 } from "three";
import { type Node, NodeMaterial, TSL, type NodeBuilder, type NodeFrame, type Renderer, type WebGPURenderer } from "three/webgpu";
import { REMEDY } from "../errors.js";
import type { DeviceTexture } from "../render/textureDevice.js";
import type { SAMPLERS } from "../render/textures.js";
import { NO_LOGARITHM, type View } from "../render/uniforms.js";
import { Data } from "../render/wgsl/data.js";
import { CORNER, textureTypes, wgslSource } from "../render/wgsl/source.js";
import type { GpuDrawing } from "./drawing.js";
import type { FieldMaterial } from "./material.js";
import { attachments, type GpuRenderer } from "./view.js";

/** The oldest release of three.js whose nodes support this. */
const LEAST_RELEASE = 187;
const LIST = "mipvogUniforms";

type Name = (typeof SAMPLERS)[number];

/** Texel formats by their three.js names. */
const KINDS = { plain: { type: FloatType, format: RGBAFormat }, whole: { type: UnsignedIntType, format: RGBAIntegerFormat } } as const;
const KIND_OF: Record<Name, keyof typeof KINDS> = { u_density: "plain", u_color: "plain", u_directional: "plain", u_table: "whole", u_skipDistances: "whole", u_weights: "plain", u_mask: "plain" };

/** A texture of a device, or one of a single texel. */
function textureOf(name: Name, handle: GPUTexture | null): Texture {
  const { type, format } = KINDS[KIND_OF[name]];
  const texel = handle ? null : { [FloatType]: new Float32Array(4), [UnsignedIntType]: new Uint32Array(4) }[type];
  const texture = name === "u_weights" ? new DataTexture(texel, 1, 1) : new Data3DTexture(texel, 1, 1, 1);
  [texture.type, texture.format, texture.minFilter, texture.magFilter] = [type, format, NearestFilter, NearestFilter];
  // As three.js's ExternalTexture has it, which has two axes alone.
  if (handle) Object.assign(texture, { isExternalTexture: true, sourceTexture: handle });
  texture.needsUpdate = true;
  return texture;
}

/** Placeholders for textures that are not loaded yet, shared by all fields. */
const standIns = new Map<Name, Texture>();

function standIn(name: Name): Texture {
  let texture = standIns.get(name);
  if (!texture) standIns.set(name, (texture = textureOf(name, null)));
  return texture;
}

/** Wrapped device textures: all objects of a field draw from the same ones. */
const wrapped = new WeakMap<DeviceTexture, Texture>();

function wrap(name: Name, made: DeviceTexture): Texture {
  let texture = wrapped.get(made);
  if (!texture) {
    const one = (texture = textureOf(name, made.handle as GPUTexture));
    wrapped.set(made, one);
    made.freed = () => one.dispose();
  }
  return texture;
}

/** The node material that a renderer makes from a `FieldMaterial`, with its properties. */
class FieldNodes extends NodeMaterial {
  declare opened: FieldMaterial["opened"];
  declare values: FieldMaterial["values"];

  override setup(builder: NodeBuilder): void {
    const { opened, values } = this;
    const data = new Data(values);
    const numbers = new Float32Array(4 * data.length);
    data.write(values, numbers);
    const types = Object.entries(textureTypes(opened)) as [Name, string][];
    const textures = types.map(([name]) => (name === "u_weights" ? TSL.texture(standIn(name)) : TSL.texture3D(standIn(name))).setName(name));
    const list = TSL.buffer(numbers, "vec4", data.length).setName(LIST);
    list.onObjectUpdate((frame: NodeFrame) => {
      const { material, renderer, object, camera } = frame;
      // Its views have one list of uniforms.
      if ((camera as ArrayCamera).isArrayCamera) return;
      const draw = (material as unknown as FieldMaterial).prepare(renderer as unknown as GpuRenderer, object as Mesh, () => viewOf(frame));
      if (!draw) return;
      data.write(draw.uniforms, numbers);
      types.forEach(([name], i) => (textures[i].value = wrap(name, draw.textures[name]!)));
    });
    const accessors = TSL.wgsl(data.source(`${LIST}.value`));
    const source = TSL.wgsl(`${wgslSource(opened)}\nvar<private> marched: Marched;`, [accessors]);
    // Parameters that are not read, so that three.js declares what the source reads by name.
    const parameters = types.map(([name, type]) => `${name}_: ${type}`).join(", ");
    const march = TSL.wgslFn(`fn marchedColor(pixel: vec2f, first: vec4f, ${parameters}) -> vec4f { marched = marchRay(pixel); return marched.color; }`, [source]);
    const depth = TSL.wgslFn("fn marchedDepth(color: vec4f) -> f32 { return marched.depth; }", [source]);
    const corner = TSL.wgslFn("fn corner(position: vec3f, first: vec4f) -> vec4f { return cornerInClip(position); }", [TSL.wgsl(CORNER, [accessors])]);
    const first = TSL.element(list as never, TSL.int(0));
    const color = (march(TSL.screenCoordinate, first, ...textures) as Node<"vec4">).toVar();
    const several = attachments(builder.renderer.getRenderTarget());
    // Nothing is drawn into several, but a shader has to be made for them.
    this.fragmentNode = several > 1 ? TSL.outputStruct(...Array.from({ length: several }, () => TSL.vec4(0))) : color;
    this.depthNode = several > 1 ? null : depth(color);
    this.vertexNode = corner(TSL.positionGeometry, first);
    super.setup(builder);
  }

  /** Colours are already premultiplied. */
  override setupOutput(_builder: NodeBuilder, output: never): never {
    return output;
  }

  /** Clipping planes do not apply, as with WebGL. */
  override setupClipping(): never {
    return null as never;
  }

  override setupHardwareClipping(builder: NodeBuilder): void {
    (builder as NodeBuilder & { hardwareClipping: boolean }).hardwareClipping = false;
  }

  /** The picture depends on more than three.js observes: on the camera, and on loaded levels. */
  override setupObserver(builder: NodeBuilder): ReturnType<NodeMaterial["setupObserver"]> {
    return Object.assign(super.setupObserver(builder), { hasNode: true });
  }
}

/** The view of a renderer's picture. */
function viewOf({ renderer, camera, object }: NodeFrame): View {
  const [{ getRenderTarget }, { near, far }] = [renderer!, camera as PerspectiveCamera];
  const target = getRenderTarget.call(renderer);
  const viewport = target ? target.viewport : renderer!.getViewport(new Vector4()).multiplyScalar(renderer!.getPixelRatio());
  return {
    world: object!.matrixWorld.elements,
    camera: camera!.matrixWorld.elements,
    projection: camera!.projectionMatrix.elements,
    viewport: viewport.toArray(),
    // Values of canvases are made display-referred after all is drawn.
    isLinear: true,
    depth: [1, 0],
    logarithm: renderer!.logarithmicDepthBuffer ? logarithmOf(near, far) : NO_LOGARITHM,
    isDownward: true,
  };
}

/** As `viewZToLogarithmicDepth`. */
function logarithmOf(near: number, far: number): [number, number, number] {
  const least = Math.max(near, 1e-6);
  return [1 / Math.log2(far / least), 0, 1 / least];
}

/** For `useGpuDrawing`. */
export const nodeDrawing: GpuDrawing = {
  adopt(any) {
    const renderer = any as unknown as WebGPURenderer;
    if (Number.parseInt(REVISION) < LEAST_RELEASE) return [`With WebGPU, fields are drawn by three.js from release ${LEAST_RELEASE} on; this is ${REVISION}.`, REMEDY.renderer];
    const { isWebGPUBackend } = renderer.backend as { isWebGPUBackend?: boolean };
    if (!isWebGPUBackend) return ["A WebGPURenderer that falls back to WebGL 2 does not draw fields.", REMEDY.renderer];
    const library = renderer.library as unknown as { getMaterialNodeClass(type: string): unknown; addMaterial(made: unknown, type: string): void };
    if (!library.getMaterialNodeClass("MipvogFieldMaterial")) library.addMaterial(FieldNodes, "MipvogFieldMaterial");
    return null;
  },

  variant(any) {
    const target = (any as unknown as Renderer).getRenderTarget();
    return `${attachments(target)} ${target?.depthBuffer ?? true}`;
  },

  ready(any, camera) {
    const { coordinateSystem } = any as unknown as Renderer;
    if (camera.coordinateSystem === coordinateSystem) return;
    camera.coordinateSystem = coordinateSystem;
    (camera as PerspectiveCamera).updateProjectionMatrix();
  },

  async read(any, target: RenderTarget) {
    const { width, height } = target;
    return (any as unknown as Renderer).readRenderTargetPixelsAsync(target, 0, 0, width, height) as Promise<Float32Array>;
  },
};
