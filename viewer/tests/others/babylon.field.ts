/** A page of somebody who shows fields with Babylon.js. */

import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import "@babylonjs/core/Loading/loadingScreen.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { StandardMaterial } from "@babylonjs/core/Materials/standardMaterial.js";
import { Color3, Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Matrix, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Viewport } from "@babylonjs/core/Maths/math.viewport.js";
import { CreatePlane } from "@babylonjs/core/Meshes/Builders/planeBuilder.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { RadianceField } from "../../src/babylon/index.js";
import { type BabylonLook, fromTop } from "./asked.js";

/** A red wall before the camera, so far away. */
function wall(camera: FreeCamera, scene: Scene, distance: number): void {
  const plane = CreatePlane("wall", { size: 100 }, scene);
  plane.parent = camera;
  plane.position.z = scene.useRightHandedSystem ? -distance : distance;
  const material = new StandardMaterial("red", scene);
  [material.emissiveColor, material.disableLighting, material.backFaceCulling] = [Color3.Red(), true, false];
  plane.material = material;
}

/** The scene of a look, and the field in it. */
async function open(look: BabylonLook): Promise<{ engine: Engine; scene: Scene; field: RadianceField }> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [look.size, look.size];
  const engine = new Engine(canvas, false, { doNotHandleContextLost: false });
  const scene = new Scene(engine);
  scene.useRightHandedSystem = look.rightHanded;
  scene.clearColor = new Color4(...look.background, 1);
  let field: RadianceField;
  if (look.address.endsWith(".glb")) {
    const { meshes } = await ImportMeshAsync(look.address, scene);
    field = meshes.find((mesh) => mesh instanceof RadianceField)!;
  } else {
    field = new RadianceField(look.address, scene);
    field.rotation.x = -Math.PI / 2;
  }
  // Babylon.js mirrors what is right-handed along x.
  const place = ([x, y, z]: number[]) => new Vector3(look.rightHanded ? x : -x, y, z);
  const camera = new FreeCamera("camera", place(look.position), scene);
  camera.setTarget(place(look.target));
  [camera.fov, camera.minZ, camera.maxZ] = [look.angle, 0.01, 100];
  if (look.wall) wall(camera, scene, look.wall);
  return { engine, scene, field };
}

/** Draws until all of a field is in the picture. */
async function drawWhole(scene: Scene, field: RadianceField): Promise<void> {
  await field.finished;
  await scene.whenReadyAsync();
  do {
    scene.render();
    await new Promise(requestAnimationFrame);
  } while (field.waiting || field.finest !== 0);
  scene.render();
}

/** Takes the device from an engine and gives it back. */
async function loseDevice(engine: Engine): Promise<void> {
  const extension = engine._gl.getExtension("WEBGL_lose_context")!;
  // It can be given back once the event is over.
  const lost = new Promise((resolve) => engine.getRenderingCanvas()!.addEventListener("webglcontextlost", () => setTimeout(resolve)));
  const back = new Promise((resolve) => engine.onContextRestoredObservable.addOnce(resolve));
  extension.loseContext();
  await lost;
  extension.restoreContext();
  await back;
}

async function pixelsOf(engine: Engine, size: number): Promise<number[]> {
  return fromTop((await engine.readPixels(0, 0, size, size)) as Uint8Array, size);
}

window.drawBabylon = async (look) => {
  const { engine, scene, field } = await open(look);
  await drawWhole(scene, field);
  if (look.losesDevice) {
    await loseDevice(engine);
    await drawWhole(scene, field);
  }
  const pixels = await pixelsOf(engine, look.size);
  field.dispose();
  engine.dispose();
  return pixels;
};

window.askBabylon = async (look, at) => {
  const { engine, scene, field } = await open(look);
  await drawWhole(scene, field);
  const count = (skips: boolean) => field.statistics(look.size / 2, look.size / 2, look.size, skips);
  const picked = at.map(([x, y]) => {
    const point = field.pick(x, y);
    const seen = point && Vector3.Project(point, Matrix.Identity(), scene.getTransformMatrix(), new Viewport(0, 0, 1, 1));
    return point && seen && { point: point.asArray(), seen: [seen.x, seen.y] };
  });
  const { min, max } = field.bounds;
  const told = { bounds: { min: min.asArray(), max: max.asArray() }, statistics: { sparse: count(true), dense: count(false) }, picked };
  scene.render();
  const pixels = await pixelsOf(engine, look.size);
  field.dispose();
  engine.dispose();
  return { told, pixels };
};

window.listBabylon = async (address) => {
  const engine = new Engine(document.createElement("canvas"), false);
  const { meshes, transformNodes } = await ImportMeshAsync(address, new Scene(engine));
  return [...meshes, ...transformNodes].map((node) => ({
    name: node.name,
    kind: node instanceof RadianceField ? "RadianceField" : node.getClassName(),
    error: node.metadata?.radianceFieldError?.message ?? null,
  }));
};

window.refuseBabylon = async (address) => {
  const engines = [new NullEngine(), new Engine(document.createElement("canvas"), false, { disableWebGL2Support: true })];
  return engines.map((engine) => {
    try {
      return `${new RadianceField(address, new Scene(engine)).name} was made`;
    } catch (error) {
      return String(error);
    }
  });
};
