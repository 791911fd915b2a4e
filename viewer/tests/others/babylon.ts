/** Babylon.js with its own loader of glTF and nothing else. */

import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import "@babylonjs/core/Loading/loadingScreen.js";
import { AppendSceneAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { fromTop } from "./asked.js";

window.draw = async ({ address, size, position, target, angle, background }) => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [size, size];
  const engine = new Engine(canvas, false);
  const scene = new Scene(engine);
  // As glTF, so that the loader does not mirror anything.
  scene.useRightHandedSystem = true;
  scene.clearColor = new Color4(...background, 1);
  await AppendSceneAsync(address, scene);
  const camera = new FreeCamera("camera", new Vector3(...position), scene);
  camera.setTarget(new Vector3(...target));
  [camera.fov, camera.minZ, camera.maxZ] = [angle, 0.01, 100];
  scene.activeCamera = camera;
  await scene.whenReadyAsync();
  scene.render();
  const pixels = (await engine.readPixels(0, 0, size, size)) as Uint8Array;
  engine.dispose();
  return fromTop(pixels, size);
};
