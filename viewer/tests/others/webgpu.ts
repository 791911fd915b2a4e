/** A page of somebody who draws fields with both renderers of three.js: what scenes are made of, for the tests to put together. */

import * as THREE from "three";
import { EffectComposer } from "three/addons/postprocessing/EffectComposer.js";
import { OutputPass } from "three/addons/postprocessing/OutputPass.js";
import { RenderPass } from "three/addons/postprocessing/RenderPass.js";
import { ClippingGroup, NodeMaterial, QuadMesh, RenderPipeline, TSL, WebGPURenderer } from "three/webgpu";
import { RadianceField } from "../../src/webgpu.js";

export type Kind = "webgl" | "webgpu";
type Both = THREE.WebGLRenderer & WebGPURenderer;

const SIZE = 64;

/** A renderer on white ground. Nothing is drawn on its canvas. */
async function rendererOf(kind: Kind, parameters: object = {}): Promise<Both> {
  const renderer = (kind === "webgl" ? new THREE.WebGLRenderer(parameters) : new WebGPURenderer(parameters)) as Both;
  if (kind === "webgpu") await renderer.init();
  renderer.setSize(SIZE, SIZE);
  renderer.setClearColor(0xffffff);
  return renderer;
}

function cameraAt(place: [number, number, number], target: [number, number, number] = [0, 0, 0]): THREE.PerspectiveCamera {
  const camera = new THREE.PerspectiveCamera(40, 1, 0.1, 100);
  camera.position.set(...place);
  camera.lookAt(...target);
  camera.updateMatrixWorld();
  return camera;
}

function fieldsIn(object: THREE.Object3D): RadianceField[] {
  const fields: RadianceField[] = [];
  object.traverse((part) => part instanceof RadianceField && fields.push(part));
  return fields;
}

/** A target with depths that can be read. */
function targetOf(options: THREE.RenderTargetOptions = {}, size = SIZE): THREE.WebGLRenderTarget {
  const depthTexture = new THREE.DepthTexture(size, size, THREE.FloatType);
  return new THREE.WebGLRenderTarget(size, size, { type: THREE.HalfFloatType, depthTexture, ...options });
}

/** Brings all levels to a renderer's device. */
async function load(renderer: Both, scene: THREE.Scene, camera: THREE.Camera): Promise<void> {
  const fields = fieldsIn(scene);
  await Promise.all(fields.map((field) => field.finished));
  const target = targetOf({}, 1);
  renderer.setRenderTarget(target);
  for (let frame = 0; frame < 300; frame++) {
    renderer.render(scene, camera);
    if (frame > 2 && fields.every((field) => !field.waiting && !field.decoding && field.finest === 0)) break;
    await new Promise((done) => setTimeout(done, 5));
  }
  renderer.setRenderTarget(null);
  target.dispose();
}

/** A target's pixels, four numbers each, rows from the top. */
async function read(renderer: Both, target: THREE.WebGLRenderTarget): Promise<number[]> {
  const { width, height, texture } = target;
  let values: ArrayLike<number>;
  if (renderer instanceof THREE.WebGLRenderer) {
    values = texture.type === THREE.FloatType ? new Float32Array(4 * width * height) : texture.type === THREE.HalfFloatType ? new Uint16Array(4 * width * height) : new Uint8Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, values as Float32Array);
  } else values = await (renderer as WebGPURenderer).readRenderTargetPixelsAsync(target, 0, 0, width, height);
  const numbers = Array.from(values, (value) => (texture.type === THREE.HalfFloatType ? THREE.DataUtils.fromHalfFloat(value) : value));
  if (!(renderer instanceof THREE.WebGLRenderer)) return numbers;
  return Array.from({ length: height }, (_, row) => numbers.slice(4 * width * (height - 1 - row), 4 * width * (height - row))).flat();
}

/** Depths of a target, 0 to 1, rows from the top. */
async function depths(renderer: Both, { width, height, depthTexture }: THREE.WebGLRenderTarget): Promise<number[]> {
  const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType, depthBuffer: false });
  const before = renderer.getRenderTarget();
  renderer.setRenderTarget(target);
  if (renderer instanceof THREE.WebGLRenderer) {
    const material = new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      uniforms: { depths: { value: depthTexture } },
      vertexShader: "in vec3 position; void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: "precision highp float; uniform highp sampler2D depths; out vec4 color; void main() { color = vec4(texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r, 0.0, 0.0, 1.0); }",
      depthTest: false,
    });
    const quad = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material);
    quad.frustumCulled = false;
    renderer.render(new THREE.Scene().add(quad), new THREE.OrthographicCamera());
  } else {
    const material = new NodeMaterial();
    material.fragmentNode = TSL.vec4(TSL.textureLoad(depthTexture!, TSL.ivec2(TSL.screenCoordinate)).r, 0, 0, 1);
    new QuadMesh(material).render(renderer as WebGPURenderer);
  }
  const values = await read(renderer, target);
  renderer.setRenderTarget(before);
  target.dispose();
  return values.filter((_, at) => at % 4 === 0);
}

/**
 * Linear values as display-referred ones, limited to the 0 to 255 of a screen: beyond 1, SwiftShader's blending of half floats
 * goes on with WebGPU and ends with WebGL.
 */
function shown(values: number[]): number[] {
  const display = (value: number) => (value <= 0.0031308 ? 12.92 * value : 1.055 * Math.max(value, 0) ** (1 / 2.4) - 0.055);
  return values.map((value, at) => 255 * (at % 4 === 3 ? value : Math.min(display(value), 1)));
}

export interface Picture {
  pixels: number[];
  depths: number[];
}

/** A picture into a target: colours as on a display, and depths. */
async function picture(renderer: Both, scene: THREE.Scene, camera: THREE.Camera, target = targetOf()): Promise<Picture> {
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const pixels = shown(await read(renderer, target));
  const found = { pixels, depths: target.depthTexture ? await depths(renderer, target) : [] };
  renderer.setRenderTarget(null);
  target.dispose();
  return found;
}

/** A field upright, and a scene with it. */
function sceneOf(address: string): { scene: THREE.Scene; field: RadianceField } {
  const field = new RadianceField(address);
  field.rotation.x = -Math.PI / 2;
  return { scene: new THREE.Scene().add(field) as THREE.Scene, field };
}

const gpu = { ClippingGroup, EffectComposer, OutputPass, RenderPass, THREE, TSL, RenderPipeline, RadianceField, SIZE, rendererOf, cameraAt, fieldsIn, targetOf, load, read, depths, shown, picture, sceneOf };
declare global {
  interface Window {
    gpu: typeof gpu;
  }
}
window.gpu = gpu;
