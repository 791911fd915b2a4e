/** A page of somebody who draws fields with the WebGPURenderer of a release that is too old for it. */

import { PerspectiveCamera, Scene, WebGLRenderTarget } from "three";
import { WebGPURenderer } from "three/webgpu";
import { RadianceField } from "../../src/webgpu.js";

async function refuse(address: string): Promise<string[]> {
  const field = new RadianceField(address);
  const errors: string[] = [];
  field.addEventListener("failed", ({ error }) => errors.push(error.message));
  await field.finished;
  const renderer = new WebGPURenderer();
  await renderer.init();
  renderer.setRenderTarget(new WebGLRenderTarget(8, 8));
  const camera = new PerspectiveCamera();
  camera.position.z = 4;
  for (let frame = 0; frame < 2; frame++) await renderer.renderAsync(new Scene().add(field), camera);
  field.dispose();
  return errors;
}

declare global {
  interface Window {
    refuse: typeof refuse;
  }
}
window.refuse = refuse;
