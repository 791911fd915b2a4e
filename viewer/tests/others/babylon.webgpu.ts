/** A page that draws fields with Babylon.js's engine for WebGPU, and tells its server how they look: no driver of browsers runs Firefox here. */

import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import type { AbstractEngine } from "@babylonjs/core/Engines/abstractEngine.js";
import { WebGPUEngine } from "@babylonjs/core/Engines/webgpuEngine.js";
import { StandardMaterial } from "@babylonjs/core/Materials/standardMaterial.js";
import { Color3, Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { CreatePlane } from "@babylonjs/core/Meshes/Builders/planeBuilder.js";
import { Scene } from "@babylonjs/core/scene.js";
import { RadianceField } from "../../src/babylon/index.js";
import type { BabylonLook } from "./asked.js";

/** What is drawn, and told. */
export interface Told {
  pixels: number[];
  rays: number;
  fetches: number;
  picked: number[] | null;
  /** What a ray hit, and what was said of it. */
  hit: boolean;
  refused: string;
}

async function engineOf(kind: string, size: number): Promise<AbstractEngine> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [size, size];
  if (kind === "webgl") return new Engine(canvas, false);
  const engine = new WebGPUEngine(canvas, { antialias: false, enableAllFeatures: kind === "all" });
  await engine.initAsync();
  return engine;
}

async function draw(look: BabylonLook, kind: string): Promise<Told> {
  const engine = await engineOf(kind, look.size);
  const scene = new Scene(engine);
  scene.useRightHandedSystem = look.rightHanded;
  scene.clearColor = new Color4(...look.background, 1);
  const place = ([x, y, z]: number[]) => new Vector3(look.rightHanded ? x : -x, y, z);
  const camera = new FreeCamera("camera", place(look.position), scene);
  camera.setTarget(place(look.target));
  [camera.fov, camera.minZ, camera.maxZ] = [look.angle, 0.01, 100];
  const field = new RadianceField(look.address, scene);
  field.rotation.x = -Math.PI / 2;
  if (look.wall) {
    const plane = CreatePlane("wall", { size: 100 }, scene);
    plane.parent = camera;
    plane.position.z = scene.useRightHandedSystem ? -look.wall : look.wall;
    const material = new StandardMaterial("red", scene);
    [material.emissiveColor, material.disableLighting, material.backFaceCulling] = [Color3.Red(), true, false];
    plane.material = material;
  }
  await field.finished;
  await scene.whenReadyAsync();
  const frame = () => {
    engine.beginFrame();
    scene.render();
  };
  for (let count = 0; count < 500 && (field.waiting || field.finest !== 0 || count < 3); count++) {
    frame();
    engine.endFrame();
    await new Promise((done) => setTimeout(done, 5));
  }
  frame();
  const reading = engine.readPixels(0, 0, look.size, look.size) as Promise<Uint8Array>;
  engine.endFrame();
  const read = Array.from(await reading);
  const isTurned = kind !== "webgl" && navigator.gpu.getPreferredCanvasFormat() === "bgra8unorm";
  const raw = isTurned ? read.map((value, at) => (at % 4 === 0 ? read[at + 2] : at % 4 === 2 ? read[at - 2] : value)) : read;
  // WebGL's rows go from the bottom.
  const rows = Array.from({ length: look.size }, (_, row) => raw.slice(4 * look.size * row, 4 * look.size * (row + 1)));
  const pixels = (kind === "webgl" ? rows.reverse() : rows).flat();
  const statistics = await field.statisticsAsync(look.size / 2, look.size / 2, look.size);
  const picked = await field.pickAsync(0.5, 0.5);
  let refused = "";
  try {
    field.pick(0.5, 0.5);
  } catch (error) {
    refused = String(error);
  }
  const told = { pixels, rays: statistics.rays, fetches: statistics.fetchesPerRay, picked: picked?.asArray() ?? null, hit: false, refused };
  field.dispose();
  engine.dispose();
  return told;
}

declare global {
  interface Window {
    drawBoth: typeof draw;
  }
}
window.drawBoth = draw;

const asked = new URL(location.href).searchParams.get("looks");
if (asked) {
  const told = async () => {
    const answers: Told[] = [];
    for (const look of JSON.parse(asked) as BabylonLook[]) answers.push(await draw(look, "all"));
    return answers;
  };
  const answer = await told().catch((error: Error) => ({ error: `${error} ${error.stack}` }));
  await fetch("/told", { method: "POST", body: JSON.stringify(answer) });
}
