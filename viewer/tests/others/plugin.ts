/** A page of somebody who uses the plugin. */

import { PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { RadianceField, RadianceFieldExtension } from "../../src/index.js";
import { type Found, fromTop } from "./asked.js";

window.list = async (address) => {
  const loader = new GLTFLoader().register((parser) => new RadianceFieldExtension(parser));
  const { scene } = await loader.loadAsync(address);
  const found: Found[] = [];
  scene.traverse((object) => {
    if (object === scene) return;
    const kind = object instanceof RadianceField ? "RadianceField" : object.type;
    found.push({ name: object.name, kind, error: object.userData.radianceFieldError?.message ?? null });
  });
  return found;
};

window.giveUp = async (address) => {
  const field = new RadianceField(address);
  field.dispose();
  const ended = await Promise.allSettled([field.opened, field.finished]);
  return ended.map((end) => (end.status === "rejected" ? end.reason.message : end.status));
};

window.drawField = async (address) => {
  const size = 48;
  const field = new RadianceField(address);
  field.rotation.x = -Math.PI / 2;
  await field.finished;
  const scene = new Scene().add(field);
  const camera = new PerspectiveCamera(40, 1, 0.01, 100);
  camera.position.set(3.5, 2, 0);
  camera.lookAt(0, 0, 0);
  const renderer = new WebGLRenderer({ preserveDrawingBuffer: true });
  renderer.setSize(size, size);
  do renderer.render(scene, camera);
  while (field.waiting);
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * size * size);
  gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return fromTop(pixels, size);
};
