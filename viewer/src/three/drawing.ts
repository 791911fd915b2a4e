/** Draws fields with WebGPU renderers. A separate module, which WebGL pages do not load. */

import type { Camera, RenderTarget } from "three";
import type { GpuRenderer } from "./view.js";

export interface GpuDrawing {
  /** Prepares a renderer for fields; otherwise, returns the reason and a remedy. */
  adopt(renderer: GpuRenderer): readonly [message: string, remedy: string] | null;
  /** The properties of a render target that shaders depend on. */
  variant(renderer: GpuRenderer): string;
  /** Gives a camera the projection that the renderer would use. */
  ready(renderer: GpuRenderer, camera: Camera): void;
  /** Reads a target, four numbers per pixel. */
  read(renderer: GpuRenderer, target: RenderTarget): Promise<Float32Array>;
}

let drawing: GpuDrawing | null = null;

/** Null if it was not imported. */
export function gpuDrawing(): GpuDrawing | null {
  return drawing;
}

export function useGpuDrawing(given: GpuDrawing): void {
  drawing = given;
}
