/** Cameras and targets of scenes of three.js, with WebGL and with WebGPU: those that show a field, and those that are refused. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { green, same } from "./pictures.js";
import { scenesOfPage } from "./scenesOfPage.js";
import { night, psnr } from "./support.js";

const scenes = scenesOfPage();

night("orthographic cameras, far planes in the box, and targets of several samples", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, load, picture, targetOf } = window.gpu;
    const all = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const { scene, field } = sceneOf(address);
      const wall = new THREE.Mesh(new THREE.PlaneGeometry(10, 10), new THREE.MeshBasicMaterial({ color: 0x00ff00, side: THREE.DoubleSide }));
      wall.rotation.y = Math.PI / 2;
      scene.add(wall);
      const renderer = await rendererOf(kind);
      const near = cameraAt([3.5, 0.8, 0]);
      await load(renderer, scene, near.clone());
      const pictures = [];
      for (const start of [0.1, -20]) {
        const camera = new THREE.OrthographicCamera(-1.4, 1.4, 1.4, -1.4, start, 20);
        camera.position.set(10, 3, 0).setLength(start > 0 ? 6 : 0.1);
        camera.lookAt(0, 0, 0);
        camera.updateMatrixWorld();
        for (const x of [-1.5, 0]) {
          wall.position.x = x;
          pictures.push(await picture(renderer, scene, camera.clone()));
        }
      }
      wall.visible = false;
      near.far = 3.6;
      near.updateProjectionMatrix();
      pictures.push(await picture(renderer, scene, near.clone()));
      near.far = 100;
      near.updateProjectionMatrix();
      pictures.push(await picture(renderer, scene, near.clone()));
      // Depths of several samples are not read.
      pictures.push(await picture(renderer, scene, near.clone(), new THREE.WebGLRenderTarget(64, 64, { type: THREE.HalfFloatType, samples: 4 })));
      pictures.push(await picture(renderer, scene, near.clone(), targetOf({ type: THREE.FloatType })));
      pictures.push(await picture(renderer, scene, near.clone(), new THREE.WebGLRenderTarget(64, 64, { type: THREE.HalfFloatType, depthBuffer: false })));
      all.push(pictures);
      field.dispose();
      await renderer.dispose();
    }
    return all;
  }, scenes.harmonics);
  same(told);
  for (const pictures of told) {
    assert.ok(green(pictures[0]) < green(pictures[1]));
    const [cut, whole, sampled, floats, flat] = pictures.slice(4).map(({ pixels }) => pixels);
    for (const other of [cut, sampled, floats, flat]) assert.ok(psnr(other, whole) > 40, `${psnr(other, whole)} dB`);
  }
  assert.deepEqual(scenes.wrong(), []);
});

test("targets of several attachments, cameras of several views and the fallback to WebGL are refused once, and the rest of the scene is drawn", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { THREE, TSL, SIZE, sceneOf, rendererOf, cameraAt, load, picture, read } = window.gpu;
    const { scene, field } = sceneOf(address);
    scene.add(new THREE.Mesh(new THREE.SphereGeometry(0.2), new THREE.MeshBasicMaterial({ color: 0x00ff00 })));
    const errors: string[] = [];
    field.addEventListener("failed", ({ error }) => errors.push(error.message));
    const renderer = await rendererOf("webgpu");
    const camera = cameraAt([3.5, 0.8, 0]);
    await load(renderer, scene, camera);
    const before = await picture(renderer, scene, camera);
    const target = new THREE.WebGLRenderTarget(SIZE, SIZE, { count: 2 });
    target.textures[0].name = "output";
    target.textures[1].name = "normal";
    renderer.setMRT(TSL.mrt({ output: TSL.output, normal: TSL.normalView }));
    renderer.setRenderTarget(target);
    for (let i = 0; i < 2; i++) renderer.render(scene, camera);
    const several = await read(renderer, target);
    renderer.setMRT(null);
    const eye = cameraAt([3.5, 0.8, 0]) as import("three").PerspectiveCamera & { viewport: import("three").Vector4 };
    eye.viewport = new THREE.Vector4(0, 0, SIZE, SIZE);
    const views = new THREE.ArrayCamera([eye]);
    views.position.copy(camera.position);
    views.quaternion.copy(camera.quaternion);
    views.updateMatrixWorld();
    const one = new THREE.WebGLRenderTarget(SIZE, SIZE, { type: THREE.HalfFloatType });
    renderer.setRenderTarget(one);
    for (let i = 0; i < 2; i++) renderer.render(scene, views);
    renderer.setRenderTarget(null);
    const after = await picture(renderer, scene, camera);
    const fallback = await rendererOf("webgpu", { forceWebGL: true });
    fallback.setRenderTarget(one);
    for (let i = 0; i < 2; i++) fallback.render(scene, cameraAt([3.5, 0.8, 0]));
    fallback.setRenderTarget(null);
    let late = "";
    try {
      field.pick(renderer as never, camera, 0.5, 0.5);
    } catch (error) {
      late = String(error);
    }
    const hits = new THREE.Raycaster(camera.position, camera.position.clone().negate().normalize()).intersectObject(field);
    field.dispose();
    await renderer.dispose();
    return { before, after, several, errors, late, hits: hits.length };
  }, scenes.harmonics);
  assert.deepEqual(told.errors, [
    "A field is not drawn into a target of several color attachments.",
    "With WebGPU, a field is not drawn for a camera of several views.",
    "A WebGPURenderer that falls back to WebGL 2 does not draw fields.",
  ]);
  assert.match(told.late, /FieldError: Renderers for WebGPU answer later/);
  assert.equal(told.hits, 0);
  assert.deepEqual(told.after, told.before);
  const mesh = told.several.filter((value, at) => at % 4 === 1 && value === 255 && told.several[at - 1] === 0).length;
  assert.ok(mesh > 10, `${mesh} pixels of the mesh`);
  const expected = [...told.errors.map((message) => `error: ${message}`), "warning: Rays do not hit"];
  assert.deepEqual(scenes.wrong().filter((problem) => !expected.some((start) => problem.startsWith(start)) && !/is not compatible/.test(problem)), []);
});

test("with WebGL, a headset's cameras each see the field from their place", async () => {
  const { both, left, right } = await scenes.page.evaluate(async (address) => {
    const { THREE, SIZE, sceneOf, rendererOf, cameraAt, load, picture, targetOf } = window.gpu;
    const { scene, field } = sceneOf(address);
    const renderer = await rendererOf("webgl");
    const eyes = [cameraAt([3.5, 0.8, -0.3]), cameraAt([3.5, 0.8, 0.3])] as (import("three").PerspectiveCamera & { viewport: import("three").Vector4 })[];
    eyes.forEach((eye, number) => (eye.viewport = new THREE.Vector4(number * SIZE, 0, SIZE, SIZE)));
    const views = new THREE.ArrayCamera(eyes);
    views.position.copy(eyes[0].position);
    views.quaternion.copy(eyes[0].quaternion);
    views.projectionMatrix.copy(eyes[0].projectionMatrix);
    views.updateMatrixWorld();
    await load(renderer, scene, cameraAt([3.5, 0.8, 0]));
    const target = targetOf();
    target.setSize(2 * SIZE, SIZE);
    const both = (await picture(renderer, scene, views, target)).pixels;
    const [left, right] = [(await picture(renderer, scene, cameraAt([3.5, 0.8, -0.3]))).pixels, (await picture(renderer, scene, cameraAt([3.5, 0.8, 0.3]))).pixels];
    field.dispose();
    renderer.dispose();
    return { both, left, right };
  }, scenes.harmonics);
  const half = (number: number) => Array.from({ length: 64 }, (_, row) => both.slice(4 * (128 * row + 64 * number), 4 * (128 * row + 64 * number + 64))).flat();
  for (const [number, eye] of [left, right].entries()) assert.ok(psnr(half(number), eye) > 60, `eye ${number}: ${psnr(half(number), eye)} dB`);
  assert.ok(psnr(left, right) < 40);
  assert.deepEqual(scenes.wrong(), []);
});
