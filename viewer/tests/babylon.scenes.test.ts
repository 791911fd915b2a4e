/** Fields in scenes of Babylon.js: copies, mirrors, cameras, depths and rays. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before } from "node:test";
import type { Browser, Page } from "playwright-core";
import { bakedScene, CountingServer, launch, newPage, night, openOther, psnr } from "./support.js";
import type {} from "./others/babylon.scenes.js";

const server = new CountingServer();
let browser: Browser;
let page: Page;
let problems: string[];
let container: string;
let asset: string;

before(async () => {
  const baked = bakedScene("tiny");
  await server.start();
  container = server.offer("tiny.mipvog", readFileSync(baked.container));
  asset = server.offer("tiny.glb", readFileSync(baked.asset));
  browser = await launch();
  ({ page, problems } = await newPage(browser));
  await openOther(page, server, "babylon.scenes");
});

after(async () => {
  await browser.close();
  server.stop();
});

/** What went wrong since this was last asked. */
function wrong(): string[] {
  return problems.splice(0);
}

for (const rightHanded of [true, false]) {
  const hand = rightHanded ? "right" : "left";

  night(`copies of every kind draw the field at their own place in a ${hand}-handed scene, and it is loaded once`, async () => {
    const { wanted, found, empty, workers } = await page.evaluate(async ([address, rightHanded]) => {
      const { ImportMeshAsync, LoadAssetContainerAsync, RadianceField, TransformNode, sceneOf, picture } = window.babylon;
      const from: [number, number, number] = [4, 2, 1];
      const shift = 0.8;
      const one = sceneOf(rightHanded, from);
      const { meshes } = await ImportMeshAsync(address, one.scene);
      const root = meshes[0];
      const empty = await (async () => {
        root.setEnabled(false);
        const pixels = await picture(one.scene);
        root.setEnabled(true);
        return pixels;
      })();
      root.position.z += shift;
      const wanted = await picture(one.scene);
      one.engine.dispose();
      const found: number[][] = [];
      const Own = Worker;
      let workers = 0;
      for (const cloneMaterials of [false, true]) {
        const { engine, scene } = sceneOf(rightHanded, from);
        const assets = await LoadAssetContainerAsync(address, scene);
        window.Worker = class extends Own {
          constructor(address: string | URL, options?: WorkerOptions) {
            super(address, options);
            workers++;
          }
        };
        for (const options of [undefined, { doNotInstantiate: false }]) {
          const { rootNodes } = assets.instantiateModelsToScene((name) => name, cloneMaterials, options);
          (rootNodes[0] as InstanceType<typeof TransformNode>).position.z += shift;
          found.push(await picture(scene));
          rootNodes.forEach((node) => node.dispose());
        }
        window.Worker = Own;
        engine.dispose();
      }
      const { engine, scene } = sceneOf(rightHanded, from);
      const loaded = await ImportMeshAsync(address, scene);
      const field = loaded.meshes.find((mesh) => mesh instanceof RadianceField)!;
      const whole = loaded.meshes[0];
      const copies = [() => whole.instantiateHierarchy(), () => whole.instantiateHierarchy(null, { doNotInstantiate: true })];
      for (const copy of copies) {
        const made = copy()!;
        made.position.z += shift;
        whole.setEnabled(false);
        made.setEnabled(true);
        found.push(await picture(scene));
        made.dispose();
        whole.setEnabled(true);
      }
      whole.position.z += shift;
      for (const make of [() => field.clone("copy"), () => field.createInstance("copy")]) {
        const copy = make();
        field.setEnabled(false);
        copy.setEnabled(true);
        found.push(await picture(scene));
        copy.dispose();
        field.setEnabled(true);
      }
      engine.dispose();
      return { wanted, found, empty, workers };
    }, [asset, rightHanded] as const);
    assert.ok(psnr(wanted, empty) < 30, "something is to be seen");
    found.forEach((picture, number) => assert.ok(psnr(picture, wanted) > 60, `copy ${number}: ${psnr(picture, wanted)} dB`));
    assert.equal(workers, 0);
    assert.deepEqual(wrong(), []);
  });

  night(`rays hit what is seen in a ${hand}-handed scene`, async () => {
    const { hits, corner } = await page.evaluate(async ([address, rightHanded]) => {
      const { RadianceField, sceneOf, picture, SIZE } = window.babylon;
      const { engine, scene, camera } = sceneOf(rightHanded, [3.2, 1.5, 0.7]);
      const field = new RadianceField(address, scene);
      field.rotation.x = -Math.PI / 2;
      await picture(scene);
      const cast = (x: number, y: number) => {
        const info = scene.pick(x * SIZE, y * SIZE)!;
        const picked = field.pick(x, y);
        const off = info.pickedPoint && picked ? info.pickedPoint.subtract(picked).length() : null;
        return { hit: info.hit, isField: info.pickedMesh === field, off, distance: info.distance, wanted: picked ? picked.subtract(camera.globalPosition).length() : null };
      };
      const hits = [[0.5, 0.5], [0.5625, 0.453125], [0.4375, 0.546875]].map(([x, y]) => cast(x, y));
      const corner = cast(0.015625, 0.015625);
      engine.dispose();
      return { hits, corner };
    }, [container, rightHanded] as const);
    for (const { hit, isField, off, distance, wanted } of hits) assert.ok(hit && isField && off! < 0.02 && Math.abs(distance - wanted!) < 0.02, JSON.stringify(hits));
    assert.ok(!corner.hit && corner.wanted === null);
    assert.deepEqual(wrong(), []);
  });

  night(`orthographic cameras of a ${hand}-handed scene see what perspective ones see from far away, and depths may be logarithmic`, async () => {
    const pictures = await page.evaluate(async ([address, rightHanded]) => {
      const { Camera, Color3, CreatePlane, RadianceField, StandardMaterial, sceneOf, picture } = window.babylon;
      const { engine, scene, camera } = sceneOf(rightHanded, [30, 10, 0]);
      const field = new RadianceField(address, scene);
      field.rotation.x = -Math.PI / 2;
      const wall = CreatePlane("wall", { size: 100 }, scene);
      wall.parent = camera;
      wall.position.z = (rightHanded ? -1 : 1) * Math.hypot(30, 10);
      const material = new StandardMaterial("green", scene);
      [material.emissiveColor, material.disableLighting, material.backFaceCulling] = [Color3.Green(), true, false];
      wall.material = material;
      const half = 1.6;
      camera.minZ = 1;
      camera.fov = 2 * Math.atan(half / Math.hypot(30, 10));
      const perspective = await picture(scene);
      material.useLogarithmicDepth = field.material!.useLogarithmicDepth = true;
      const logarithmic = await picture(scene);
      material.useLogarithmicDepth = field.material!.useLogarithmicDepth = false;
      camera.mode = Camera.ORTHOGRAPHIC_CAMERA;
      [camera.orthoLeft, camera.orthoRight, camera.orthoTop, camera.orthoBottom] = [-half, half, half, -half];
      const parallel = await picture(scene);
      field.setEnabled(false);
      const empty = await picture(scene);
      engine.dispose();
      return { perspective, logarithmic, parallel, empty };
    }, [container, rightHanded] as const);
    assert.ok(psnr(pictures.perspective, pictures.empty) < 25);
    assert.ok(psnr(pictures.logarithmic, pictures.perspective) > 50, `${psnr(pictures.logarithmic, pictures.perspective)} dB`);
    assert.ok(psnr(pictures.parallel, pictures.perspective) > 30, `${psnr(pictures.parallel, pictures.perspective)} dB`);
    assert.deepEqual(wrong(), []);
  });
}
