/** three.js with its own GLTFLoader and nothing else. */

import { Color, PerspectiveCamera, Scene, SRGBColorSpace, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { fromTop } from "./asked.js";

window.draw = async ({ address, size, position, target, angle, background }) => {
  const { scene: asset } = await new GLTFLoader().loadAsync(address);
  const scene = new Scene().add(asset);
  scene.background = new Color().setRGB(...background, SRGBColorSpace);
  const camera = new PerspectiveCamera((180 / Math.PI) * angle, 1, 0.01, 100);
  camera.position.set(...position);
  camera.lookAt(...target);
  const renderer = new WebGLRenderer();
  renderer.setSize(size, size);
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * size * size);
  gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  renderer.dispose();
  return fromTop(pixels, size);
};
