/** What draws fields with renderers for WebGPU. It is a part of its own, which others do not load. */

import type { Camera, RenderTarget } from "three";
import type { GpuRenderer } from "./view.js";

export interface GpuDrawing {
  /** Lets a renderer draw fields; else why it cannot, and a remedy. */
  adopt(renderer: GpuRenderer): readonly [message: string, remedy: string] | null;
  /** What of the target that a renderer draws into shaders depend on. */
  variant(renderer: GpuRenderer): string;
  /** Gives a camera the projection that the renderer would. */
  ready(renderer: GpuRenderer, camera: Camera): void;
  /** The numbers of a target, four of each pixel. */
  read(renderer: GpuRenderer, target: RenderTarget): Promise<Float32Array>;
}

let drawing: GpuDrawing | null = null;

/** Null where it was not imported. */
export function gpuDrawing(): GpuDrawing | null {
  return drawing;
}

export function useGpuDrawing(given: GpuDrawing): void {
  drawing = given;
}
