/** A page of somebody who uses the plugin. */

import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { RadianceField, RadianceFieldExtension } from "../../src/index.js";
import type { Found } from "./asked.js";

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
