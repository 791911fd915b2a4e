import { ArcRotateCamera } from "@babylonjs/core/Cameras/arcRotateCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import { RadianceField } from "mipvog-viewer/babylon";

const canvas = document.getElementById("picture");
const engine = new Engine(canvas);
const scene = new Scene(engine);
scene.clearColor = new Color4(1, 1, 1, 1);
const camera = new ArcRotateCamera("camera", 0, Math.PI / 3, 4.5, Vector3.Zero(), scene);
camera.attachControl(canvas);
[camera.fov, camera.minZ] = [0.7, 0.01];

const field = new RadianceField("scene.mipvog", scene);
field.rotation.x = -Math.PI / 2; // training's z up to Babylon.js's y up
engine.runRenderLoop(() => scene.render());
