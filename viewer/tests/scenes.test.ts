/** Fields in scenes of three.js: scales, mirrors, cameras, depths, targets and rays. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { drawn, openStudio, type Studio } from "./studio.js";
import { night, psnr } from "./support.js";

let studio: Studio;

before(async () => {
  studio = await openStudio();
});

after(() => studio.close());

/** A picture whose left is right. */
function flipped(pixels: number[], size = 64): number[] {
  return pixels.map((_, at) => {
    const [pixel, channel] = [at >> 2, at & 3];
    return pixels[4 * (pixel - (pixel % size) + size - 1 - (pixel % size)) + channel];
  });
}

night("a field is drawn from any distance and at any scale", async () => {
  const pictures = await studio.page.evaluate(async (address) => {
    const { sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const { scene, field } = sceneOf(address);
    const renderer = rendererOf();
    const look = (distance: number, scale: number) => {
      field.scale.setScalar(scale);
      return picture(renderer, scene, cameraAt([distance * scale, 0.6 * distance * scale, 0]));
    };
    const far = [];
    for (const distance of [1, 2, 4, 8, 16]) far.push(await look(distance, 1));
    const scaled = [await look(2.5, 1), await look(2.5, 0.1), await look(2.5, 10)];
    field.dispose();
    return { far, scaled };
  }, studio.lego);
  const counts = pictures.far.map(drawn);
  assert.ok(counts.at(-1)! > 15, `${counts} pixels`);
  counts.slice(1).forEach((count, i) => assert.ok(count < counts[i] || counts[i] === 64 * 64, `${counts} pixels`));
  for (const picture of pictures.scaled.slice(1)) assert.ok(psnr(picture, pictures.scaled[0]) > 50, `${psnr(picture, pictures.scaled[0])} dB`);
  assert.deepEqual(studio.wrong(), []);
});

for (const name of ["lego", "harmonics"]) {
  night(`a mirrored node of ${name} shows the mirror image, highlights included`, async () => {
    const pictures = await studio.page.evaluate(async (address) => {
      const { THREE, sceneOf, rendererOf, cameraAt, picture } = window.lib;
      const { scene, field } = sceneOf(address);
      const outer = new THREE.Group().add(field);
      scene.add(outer);
      const renderer = rendererOf();
      const from: [number, number, number] = [2.6, 1.4, 1.9];
      const plain = await picture(renderer, scene, cameraAt(from));
      const mirrored = [];
      for (const axis of [0, 1, 2]) {
        outer.scale.set(1, 1, 1).setComponent(axis, -1);
        const camera = cameraAt(from.map((value, i) => (i === axis ? -value : value)) as [number, number, number]);
        camera.up.setComponent(1, axis === 1 ? -1 : 1);
        camera.lookAt(0, 0, 0);
        mirrored.push(await picture(renderer, scene, camera));
      }
      field.dispose();
      return { plain, mirrored };
    }, name === "lego" ? studio.lego : studio.harmonics);
    assert.ok(drawn(pictures.plain) > 300);
    for (const picture of pictures.mirrored) {
      const found = psnr(flipped(picture), pictures.plain);
      assert.ok(found > 45, `${found} dB`);
    }
    assert.deepEqual(studio.wrong(), []);
  });
}

night("targets of headsets get the canvas's values, others linear ones", async () => {
  const pictures = await studio.page.evaluate(async (address) => {
    const { THREE, SIZE, sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const { scene, field } = sceneOf(address);
    const renderer = rendererOf();
    const camera = cameraAt([3, 2, 0]);
    const canvas = await picture(renderer, scene, camera);
    const into = (options: object, isXR: boolean) => {
      const target = Object.assign(new THREE.WebGLRenderTarget(SIZE, SIZE, options), { isXRRenderTarget: isXR });
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
      const pixels = new Uint8Array(4 * SIZE * SIZE);
      renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, pixels);
      renderer.setRenderTarget(null);
      target.dispose();
      return Array.from({ length: SIZE }, (_, row) => Array.from(pixels.subarray(4 * SIZE * (SIZE - 1 - row), 4 * SIZE * (SIZE - row)))).flat();
    };
    // The device's own framebuffer of a headset converts nothing.
    const headset = into({ colorSpace: THREE.SRGBColorSpace, internalFormat: "RGBA8" }, true);
    const plain = into({}, false);
    field.dispose();
    return { canvas, headset, plain };
  }, studio.lego);
  assert.ok(psnr(pictures.headset, pictures.canvas) > 60, `${psnr(pictures.headset, pictures.canvas)} dB`);
  assert.ok(psnr(pictures.plain, pictures.canvas) < 25);
});

test("meshes hide a field and are hidden by it with every kind of depth", async () => {
  const pictures = await studio.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const all: number[][] = [];
    for (const parameters of [{}, { logarithmicDepthBuffer: true }, { reversedDepthBuffer: true }]) {
      const { scene, field } = sceneOf(address);
      const wall = new THREE.Mesh(new THREE.PlaneGeometry(10, 10), new THREE.MeshBasicMaterial({ color: 0x00ff00, side: THREE.DoubleSide }));
      scene.add(wall);
      wall.rotation.y = Math.PI / 2;
      const renderer = rendererOf(parameters);
      for (const x of [-1.2, 0, 1.2]) {
        wall.position.x = x;
        all.push(await picture(renderer, scene, cameraAt([3.5, 0.8, 0])));
      }
      field.dispose();
      renderer.dispose();
    }
    return all;
  }, studio.harmonics);
  const green = pictures.map((picture) => picture.filter((value, at) => at % 4 === 1 && value === 255 && picture[at - 1] === 0).length);
  // The wall behind, through the middle, and before the field.
  assert.ok(green[0] < green[1] && green[1] < green[2], `${green}`);
  for (const kind of [1, 2]) {
    for (const place of [0, 1, 2]) {
      const found = psnr(pictures[3 * kind + place], pictures[place]);
      assert.ok(found > 45, `kind ${kind}, wall ${place}: ${found} dB`);
    }
  }
  assert.deepEqual(studio.wrong(), []);
});

night("a far plane within the box cuts nothing off", async () => {
  const [whole, ...cut] = await studio.page.evaluate(async (address) => {
    const { sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const pictures = [];
    for (const parameters of [{}, { reversedDepthBuffer: true }]) {
      const { scene, field } = sceneOf(address);
      const renderer = rendererOf(parameters);
      for (const far of [100, 4.6, 4.2]) {
        const camera = cameraAt([3.6, 1, 0]);
        camera.far = far;
        camera.updateProjectionMatrix();
        pictures.push(await picture(renderer, scene, camera));
      }
      field.dispose();
      renderer.dispose();
    }
    return pictures;
  }, studio.lego);
  assert.ok(drawn(whole) > 500);
  cut.forEach((picture) => assert.ok(psnr(picture, whole) > 60, `${psnr(picture, whole)} dB`));
});

night("orthographic cameras see what perspective ones see from very far away, meshes hide and are hidden, and points are picked", async () => {
  const told = await studio.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const all = [];
    for (const parameters of [{}, { logarithmicDepthBuffer: true }, { reversedDepthBuffer: true }]) {
      const { scene, field } = sceneOf(address);
      const wall = new THREE.Mesh(new THREE.PlaneGeometry(10, 10), new THREE.MeshBasicMaterial({ color: 0x00ff00, side: THREE.DoubleSide }));
      wall.rotation.y = Math.PI / 2;
      scene.add(wall);
      const renderer = rendererOf(parameters);
      const away = cameraAt([1000, 300, 0]);
      Object.assign(away, { near: 900, far: 1100, fov: (2 * 180 * Math.atan(1.4 / Math.hypot(1000, 300))) / Math.PI });
      away.updateProjectionMatrix();
      for (const near of [0.1, -20]) {
        const camera = new THREE.OrthographicCamera(-1.4, 1.4, 1.4, -1.4, near, 20);
        camera.position.set(1000, 300, 0).setLength(near > 0 ? 6 : 0.1);
        camera.lookAt(0, 0, 0);
        camera.updateMatrixWorld();
        for (const x of [-1.5, 0]) {
          wall.position.x = x;
          all.push([await picture(renderer, scene, away), await picture(renderer, scene, camera)]);
        }
        const [x, y] = [0.45, 0.55];
        const point = field.pick(renderer, camera, x, y)!;
        const seen = point.clone().project(camera);
        const raycaster = new THREE.Raycaster();
        raycaster.setFromCamera(new THREE.Vector2(2 * x - 1, 1 - 2 * y), camera);
        if (near > 0 && Math.hypot(seen.x - (2 * x - 1), seen.y - (1 - 2 * y), raycaster.intersectObject(field)[0].point.distanceTo(point)) > 0.03) throw new Error("picked aside");
      }
      field.dispose();
      renderer.dispose();
    }
    return all;
  }, studio.lego);
  for (const [far, parallel] of told) {
    assert.ok(drawn(parallel) > 500);
    assert.ok(psnr(far, parallel) > 33, `${psnr(far, parallel)} dB`);
  }
  for (const [, parallel] of told.slice(2)) assert.ok(Math.max(psnr(parallel, told[0][1]), psnr(parallel, told[1][1])) > 45);
  assert.deepEqual(studio.wrong(), []);
});

night("rays hit what is seen, and no other pass draws the box", async () => {
  const told = await studio.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, picture, pixelsOf } = window.lib;
    const { scene, field } = sceneOf(address);
    const renderer = rendererOf();
    const camera = cameraAt([3.6, 1.4, 0.4]);
    const raycaster = new THREE.Raycaster();
    const cast = (x: number, y: number) => {
      raycaster.setFromCamera(new THREE.Vector2(2 * x - 1, 1 - 2 * y), camera);
      const [hit] = raycaster.intersectObject(scene);
      const picked = field.pick(renderer, camera, x, y);
      return { hit: hit && { distance: hit.distance, isField: hit.object === field, off: picked ? hit.point.distanceTo(picked) : null }, picked: picked !== null };
    };
    const before = cast(0.5, 0.5).hit;
    const shown = await picture(renderer, scene, camera);
    const casts = [[0.5, 0.5], [0.55, 0.45], [0.4, 0.6], [0.02, 0.02], [0.98, 0.02]].map(([x, y]) => cast(x, y));
    raycaster.far = 1;
    const nearOnly = cast(0.5, 0.5).hit;
    // As passes of normals and of depths do, and a light with shadows.
    scene.overrideMaterial = new THREE.MeshNormalMaterial();
    renderer.render(scene, camera);
    const normals = pixelsOf(renderer);
    scene.overrideMaterial = null;
    const light = new THREE.DirectionalLight();
    light.castShadow = field.castShadow = true;
    light.position.set(0, 5, 0);
    const floor = new THREE.Mesh(new THREE.PlaneGeometry(20, 20), new THREE.MeshLambertMaterial());
    floor.rotation.x = -Math.PI / 2;
    floor.position.y = -2;
    floor.receiveShadow = true;
    scene.add(light, floor);
    renderer.shadowMap.enabled = true;
    renderer.render(scene, camera);
    const lit = pixelsOf(renderer);
    renderer.render(scene, camera);
    const again = pixelsOf(renderer);
    light.castShadow = false;
    renderer.render(scene, camera);
    const unshadowed = pixelsOf(renderer);
    field.dispose();
    return { before, shown, casts, nearOnly, normals, lit, again, unshadowed };
  }, studio.lego);
  assert.equal(told.before, undefined);
  assert.equal(told.nearOnly, undefined);
  for (const { hit, picked } of told.casts) {
    assert.equal(hit !== undefined, picked);
    if (hit) assert.ok(hit.isField && hit.distance > 2 && hit.distance < 5 && hit.off! < 0.02, JSON.stringify(hit));
  }
  assert.deepEqual(told.casts.map(({ picked }) => picked), [true, true, true, false, false]);
  assert.equal(drawn(told.normals), 0);
  assert.deepEqual(told.lit, told.unshadowed);
  assert.deepEqual(told.again, told.unshadowed);
  assert.deepEqual(studio.wrong(), []);
});

test("what cannot draw a field is told once, and the rest of the scene is drawn", async () => {
  const told = await studio.page.evaluate(async (address) => {
    const { THREE, SIZE, sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const { scene, field } = sceneOf(address);
    const errors: string[] = [];
    field.addEventListener("failed", ({ error }) => errors.push(`${error.name}: ${error.message} ${error.remedy}`));
    const renderer = rendererOf();
    const whole = await picture(renderer, scene, cameraAt([3.6, 1, 0]));
    const target = new THREE.WebGLRenderTarget(SIZE, SIZE, { count: 2 });
    renderer.setRenderTarget(target);
    for (let i = 0; i < 3; i++) renderer.render(scene, cameraAt([3.6, 1, 0]));
    const glError = renderer.getContext().getError();
    renderer.setRenderTarget(null);
    const again = await picture(renderer, scene, cameraAt([3.6, 1, 0]));
    field.dispose();
    return { whole, glError, again, errors };
  }, studio.lego);
  assert.deepEqual(told.errors, ["FieldError: A field is not drawn into a target of several color attachments. Draw it in a pass of its own, with one color attachment."]);
  assert.equal(told.glError, 0);
  assert.deepEqual(told.again, told.whole);
  assert.deepEqual(studio.wrong().filter((problem) => !problem.includes("several color attachments")), []);
});

test("a renderer for WebGPU draws the rest of the scene without its import, and the field says why it is not in it", async () => {
  const told = 'A WebGPURenderer draws fields only where mipvog-viewer/webgpu is imported. Import RadianceField from "mipvog-viewer/webgpu", or make a WebGLRenderer.';
  const { errors, pixel } = await studio.page.evaluate(async (address) => {
    const { THREE, WebGPURenderer, SIZE, sceneOf, cameraAt } = window.lib;
    const { scene, field } = sceneOf(address);
    const errors: string[] = [];
    field.addEventListener("failed", ({ error }) => errors.push(`${error.name}: ${error.message} ${error.remedy}`));
    await field.finished;
    scene.add(new THREE.Mesh(new THREE.SphereGeometry(0.5), new THREE.MeshBasicMaterial({ color: 0xff0000 })));
    const renderer = new WebGPURenderer({ forceWebGL: true });
    renderer.setSize(SIZE, SIZE);
    await renderer.init();
    for (let frame = 0; frame < 3; frame++) renderer.render(scene, cameraAt([3.6, 1, 0]));
    const picture = await createImageBitmap(renderer.domElement);
    const context = new OffscreenCanvas(SIZE, SIZE).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    field.dispose();
    return { errors, pixel: Array.from(context.getImageData(SIZE / 2, SIZE / 2, 1, 1).data) };
  }, studio.lego);
  assert.deepEqual(errors, [`FieldError: ${told}`]);
  assert.deepEqual(pixel.slice(0, 2), [255, 0]);
  assert.deepEqual(studio.wrong().filter((problem) => !/Material "MipvogFieldMaterial" is not compatible/.test(problem)), [`error: ${told}`]);
});
