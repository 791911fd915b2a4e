/** A page of somebody who has fields in scenes of three.js of many kinds: what they are made of, for the tests to put together. */

import * as THREE from "three";
import { WebGPURenderer } from "three/webgpu";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import * as SkeletonUtils from "three/addons/utils/SkeletonUtils.js";
import { RadianceField, RadianceFieldExtension } from "../../src/index.js";
import { fromTop } from "./asked.js";

const SIZE = 64;

/** A renderer of 64 by 64 pixels on white ground. */
function rendererOf(parameters: THREE.WebGLRendererParameters = {}): THREE.WebGLRenderer {
  const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true, ...parameters });
  renderer.setSize(SIZE, SIZE);
  renderer.setClearColor(0xffffff);
  return renderer;
}

/** A camera that looks at a point. */
function cameraAt(place: [number, number, number], target: [number, number, number] = [0, 0, 0]): THREE.PerspectiveCamera {
  const camera = new THREE.PerspectiveCamera(40, 1, 0.01, 100);
  camera.position.set(...place);
  camera.lookAt(...target);
  camera.updateMatrixWorld();
  return camera;
}

/** The fields in an object. */
function fieldsIn(object: THREE.Object3D): RadianceField[] {
  const fields: RadianceField[] = [];
  object.traverse((part) => part instanceof RadianceField && fields.push(part));
  return fields;
}

/** Draws until all of the scene's fields are in the picture, but at most for so many frames; its pixels. */
async function picture(renderer: THREE.WebGLRenderer, scene: THREE.Scene, camera: THREE.Camera, frames = 200): Promise<number[]> {
  const fields = fieldsIn(scene);
  await Promise.all(fields.map((field) => field.finished));
  for (let frame = 0; frame < frames; frame++) {
    renderer.render(scene, camera);
    if (fields.every((field) => !field.waiting && !field.decoding && field.finest === 0)) break;
    await new Promise(requestAnimationFrame);
  }
  renderer.render(scene, camera);
  return pixelsOf(renderer);
}

/** What the renderer's canvas has now. */
function pixelsOf(renderer: THREE.WebGLRenderer): number[] {
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * SIZE * SIZE);
  gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return fromTop(pixels, SIZE);
}

/** A field upright, and a scene with it. */
function sceneOf(address: string): { scene: THREE.Scene; field: RadianceField } {
  const field = new RadianceField(address);
  field.rotation.x = -Math.PI / 2;
  return { scene: new THREE.Scene().add(field) as THREE.Scene, field };
}

const lib = { THREE, WebGPURenderer, GLTFLoader, SkeletonUtils, RadianceField, RadianceFieldExtension, SIZE, rendererOf, cameraAt, fieldsIn, picture, pixelsOf, sceneOf };
declare global {
  interface Window {
    lib: typeof lib;
  }
}
window.lib = lib;
