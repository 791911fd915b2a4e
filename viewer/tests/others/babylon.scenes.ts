/** A page of somebody who has fields in scenes of Babylon.js of many kinds: what they are made of, for the tests to put together. */

import "@babylonjs/core/Culling/ray.js";
import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Camera } from "@babylonjs/core/Cameras/camera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import "@babylonjs/core/Loading/loadingScreen.js";
import { ImportMeshAsync, LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { StandardMaterial } from "@babylonjs/core/Materials/standardMaterial.js";
import { Color3, Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { CreatePlane } from "@babylonjs/core/Meshes/Builders/planeBuilder.js";
import { TransformNode } from "@babylonjs/core/Meshes/transformNode.js";
import { WebRequest } from "@babylonjs/core/Misc/webRequest.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { RadianceField } from "../../src/babylon/index.js";
import { fromTop } from "./asked.js";

const SIZE = 64;

/** An empty scene on white ground, with a camera that looks at the origin from a place that glTF would name so. */
function sceneOf(rightHanded: boolean, [x, y, z]: [number, number, number]): { engine: Engine; scene: Scene; camera: FreeCamera } {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [SIZE, SIZE];
  const engine = new Engine(canvas, false);
  const scene = new Scene(engine);
  scene.useRightHandedSystem = rightHanded;
  scene.clearColor = new Color4(1, 1, 1, 1);
  const camera = new FreeCamera("camera", new Vector3(rightHanded ? x : -x, y, z), scene);
  camera.setTarget(Vector3.Zero());
  [camera.fov, camera.minZ, camera.maxZ] = [0.7, 0.01, 100];
  return { engine, scene, camera };
}

/** Draws until all fields are in the picture; its pixels. */
async function picture(scene: Scene, frames = 300): Promise<number[]> {
  const fields = scene.meshes.filter((mesh) => mesh instanceof RadianceField);
  await Promise.all(fields.map((field) => field.finished));
  await scene.whenReadyAsync();
  for (let frame = 0; frame < frames; frame++) {
    scene.render();
    if (fields.every((field) => !field.isEnabled() || (!field.waiting && field.finest === 0))) break;
    await new Promise(requestAnimationFrame);
  }
  scene.render();
  return fromTop((await scene.getEngine().readPixels(0, 0, SIZE, SIZE)) as Uint8Array, SIZE);
}

const babylon = { Camera, Color3, CreatePlane, ImportMeshAsync, LoadAssetContainerAsync, RadianceField, StandardMaterial, TransformNode, Vector3, WebRequest, sceneOf, picture, SIZE };
declare global {
  interface Window {
    babylon: typeof babylon;
  }
}
window.babylon = babylon;
