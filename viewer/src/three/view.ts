/** The parts of three.js's renderers and cameras that a field needs. */

import { type Camera, LinearSRGBColorSpace, type PerspectiveCamera, SRGBColorSpace, Vector4, type WebGLRenderer, type WebGLRenderTarget } from "three";
import { glDevice } from "../render/glDevice.js";
import { gpuDevice } from "../render/gpuDevice.js";
import type { TextureDevice } from "../render/textureDevice.js";
import { logarithmOf, NO_LOGARITHM, type View } from "../render/uniforms.js";

/** A WebGPU renderer, for modules that do not import it. */
export interface GpuRenderer {
  readonly isWebGPURenderer: true;
}

export type AnyRenderer = WebGLRenderer | GpuRenderer;

export function isWebGL(renderer: AnyRenderer): renderer is WebGLRenderer {
  // Release 160 does not name its class.
  return (renderer as { isWebGPURenderer?: boolean }).isWebGPURenderer !== true && "properties" in renderer;
}

/** The texture device of a renderer; null before it has started. */
export function deviceOf(renderer: AnyRenderer): TextureDevice | null {
  if (isWebGL(renderer)) return glDevice(renderer.getContext() as WebGL2RenderingContext);
  const { device } = (renderer as { backend?: { device?: GPUDevice | null } }).backend ?? {};
  return device ? gpuDevice(device) : null;
}

/** Number of colour attachments of a target. */
export function attachments(target: object | null): number {
  // Named otherwise before release 162.
  const { textures, texture } = (target ?? {}) as { textures?: unknown[]; texture?: unknown };
  return textures?.length ?? (Array.isArray(texture) ? texture.length : 1);
}

/** The color space of the render target. */
function colorSpaceOf(renderer: WebGLRenderer): string {
  const target = renderer.getRenderTarget() as (WebGLRenderTarget & { isXRRenderTarget?: boolean }) | null;
  if (!target) return renderer.outputColorSpace;
  // A headset shows its target as a canvas is shown.
  return target.isXRRenderTarget ? target.texture.colorSpace : LinearSRGBColorSpace;
}

/** The view of a renderer's picture. */
export function viewOf(camera: Camera, world: number[], renderer: WebGLRenderer): View {
  // An eye of a headset has a part of the picture.
  const { viewport: own, far } = camera as PerspectiveCamera & { viewport?: Vector4 };
  const viewport = own ?? renderer.getCurrentViewport(new Vector4());
  const { width, height } = renderer.domElement;
  // Named `reverseDepthBuffer` before release 182.
  const { reversedDepthBuffer, reverseDepthBuffer, logarithmicDepthBuffer } = renderer.capabilities as typeof renderer.capabilities & { reverseDepthBuffer?: boolean };
  return {
    world,
    camera: camera.matrixWorld.elements,
    projection: camera.projectionMatrix.elements,
    // Unknown to renderers whose size was never set.
    viewport: viewport.z === 0 ? [0, 0, width, height] : viewport.toArray(),
    isLinear: colorSpaceOf(renderer) !== SRGBColorSpace,
    depth: (reversedDepthBuffer ?? reverseDepthBuffer) ? [1, 0] : [0.5, 0.5],
    logarithm: logarithmicDepthBuffer ? logarithmOf(far) : NO_LOGARITHM,
  };
}
