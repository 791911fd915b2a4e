/** Fields among what else scenes of three.js have, with WebGL and with WebGPU, which look the same: one test of each row of the README's table. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { drawn, green, same } from "./pictures.js";
import { scenesOfPage } from "./scenesOfPage.js";
import { night, psnr } from "./support.js";

const scenes = scenesOfPage();

night("opaque and transparent meshes hide a field and are hidden by it, with every kind of depth", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const all = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const pictures = [];
      for (const parameters of [{}, { logarithmicDepthBuffer: true }, { reversedDepthBuffer: true }]) {
        const { scene, field } = sceneOf(address);
        const color = { color: 0x00ff00, side: THREE.DoubleSide };
        const wall = new THREE.Mesh(new THREE.PlaneGeometry(10, 10));
        wall.rotation.y = Math.PI / 2;
        scene.add(wall);
        const renderer = await rendererOf(kind, parameters);
        const camera = cameraAt([3.5, 0.8, 0]);
        // WebGL sorts the first picture of a camera as if depths were not reversed.
        await load(renderer, scene, camera);
        for (const opacity of [1, 0.5]) {
          wall.material = new THREE.MeshBasicMaterial(opacity < 1 ? { ...color, opacity, transparent: true, depthWrite: false } : color);
          for (const x of [-1.2, 0.15, 1.2]) {
            wall.position.x = x;
            pictures.push(await picture(renderer, scene, camera));
          }
        }
        field.dispose();
        await renderer.dispose();
      }
      all.push(pictures);
    }
    return all;
  }, scenes.harmonics);
  const [webgl, webgpu] = told;
  same([webgl.slice(0, 6), webgpu.slice(0, 6)]);
  for (const pictures of told) {
    const [behind, through, before] = pictures.map(green);
    assert.ok(behind < through && through < before, `${[behind, through, before]}`);
    // Of a logarithm, frameworks have their own: the pictures are what is the same.
    for (const kind of [1, 2]) {
      pictures.slice(0, 6).forEach((picture, number) => {
        const found = psnr(picture.pixels, pictures[6 * kind + number].pixels);
        assert.ok(found > 45, `kind ${kind}, ${number}: ${found} dB`);
      });
    }
  }
  assert.deepEqual(scenes.wrong(), []);
});

test("a field casts no shadow and receives none", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const all = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const { scene, field } = sceneOf(address);
      const light = new THREE.DirectionalLight(0xffffff, 2);
      light.position.set(0, 5, 0);
      const [floor, roof] = [0, 1].map(() => new THREE.Mesh(new THREE.PlaneGeometry(4, 4), new THREE.MeshLambertMaterial({ side: THREE.DoubleSide })));
      floor.rotation.x = roof.rotation.x = -Math.PI / 2;
      [floor.position.y, roof.position.y] = [-2, 2];
      floor.receiveShadow = field.receiveShadow = field.castShadow = true;
      scene.add(light, floor);
      const renderer = await rendererOf(kind);
      renderer.shadowMap.enabled = true;
      const camera = cameraAt([4, 1, 0]);
      await load(renderer, scene, camera.clone());
      const pictures = [await picture(renderer, scene, camera.clone())];
      light.castShadow = true;
      pictures.push(await picture(renderer, scene, camera.clone()));
      // What would throw a shadow on the field is not seen.
      roof.castShadow = true;
      floor.receiveShadow = false;
      roof.layers.set(0);
      roof.material.colorWrite = roof.material.depthWrite = false;
      scene.add(roof);
      pictures.push(await picture(renderer, scene, camera.clone()));
      all.push(pictures);
      field.dispose();
      await renderer.dispose();
    }
    return all;
  }, scenes.harmonics);
  same(told);
  for (const [none, cast, received] of told) {
    assert.ok(psnr(none.pixels, cast.pixels) > 60, `${psnr(none.pixels, cast.pixels)} dB with a shadow`);
    assert.ok(psnr(none.pixels, received.pixels) > 60, `${psnr(none.pixels, received.pixels)} dB under a roof`);
  }
  assert.deepEqual(scenes.wrong(), []);
});

night("fields that overlap are drawn from far to near by their origins, and one is hidden where another's depth is before its own", async () => {
  const told = await scenes.page.evaluate(async ([one, two]) => {
    const { RadianceField, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const all = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const { scene, field } = sceneOf(one);
      const other = new RadianceField(two);
      other.rotation.x = -Math.PI / 2;
      scene.add(other);
      const renderer = await rendererOf(kind);
      const camera = cameraAt([4, 1.5, 0]);
      await load(renderer, scene, camera.clone());
      const pictures = [];
      for (const z of [0.9, -0.9]) {
        for (const x of [-0.7, 0.7]) {
          other.position.set(x, 0, 0.5 * z);
          pictures.push(await picture(renderer, scene, camera.clone()));
          field.visible = false;
          pictures.push(await picture(renderer, scene, camera.clone()));
          [field.visible, other.visible] = [true, false];
          pictures.push(await picture(renderer, scene, camera.clone()));
          other.visible = true;
        }
      }
      all.push(pictures);
      field.dispose();
      other.dispose();
      await renderer.dispose();
    }
    return all;
  }, [scenes.harmonics, scenes.tiny] as const);
  same(told);
  for (const pictures of told) {
    for (let at = 0; at < pictures.length; at += 3) {
      const [both, other, field] = pictures.slice(at, at + 3);
      // Depths are those of what is nearer.
      both.depths.forEach((depth, pixel) => assert.ok(Math.abs(depth - Math.min(other.depths[pixel], field.depths[pixel])) < 1e-5));
    }
  }
  assert.deepEqual(scenes.wrong(), []);
});

night("a field is drawn many times, below any parent, from one set of textures", async () => {
  const { pictures, volumes } = await scenes.page.evaluate(async (address) => {
    const { THREE, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const own = GPUDevice.prototype.createTexture;
    let volumes = 0;
    GPUDevice.prototype.createTexture = function (descriptor) {
      const { depthOrArrayLayers = 1 } = descriptor.size as GPUExtent3DDict;
      if (descriptor.dimension === "3d" && depthOrArrayLayers > 1) volumes++;
      return own.call(this, descriptor);
    };
    const pictures = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const { scene, field } = sceneOf(address);
      const renderer = await rendererOf(kind);
      const copies = [[1, 1, 1], [-1, 1, 1], [0.5, 1.5, 1], [1, -0.7, 1]].map((scale, number) => {
        const group = new THREE.Group();
        group.scale.set(...(scale as [number, number, number]));
        group.position.set(-0.5 * number, 0.6 * (number % 2), -2.4 + 1.6 * number);
        group.rotation.set(0.3 * number, 0.5 * number, 0.2);
        const outer = new THREE.Group();
        outer.rotation.y = 0.4;
        outer.scale.setScalar(0.9);
        scene.add(outer.add(group.add(field.clone())));
        return group;
      });
      field.removeFromParent();
      const camera = cameraAt([7, 2, 0]);
      await load(renderer, scene, camera.clone());
      const of = [await picture(renderer, scene, camera.clone())];
      for (const copy of copies) {
        copies.forEach((other) => (other.visible = other === copy));
        of.push(await picture(renderer, scene, camera.clone()));
      }
      pictures.push(of);
      copies.forEach((copy) => (copy.children[0] as typeof field).dispose());
      field.dispose();
      await renderer.dispose();
    }
    GPUDevice.prototype.createTexture = own;
    return { pictures, volumes };
  }, scenes.harmonics);
  same(pictures);
  for (const [all, ...each] of pictures) {
    assert.ok(each.every((one) => drawn(one) > 60), `${each.map(drawn)}`);
    assert.ok(drawn(all) > Math.max(...each.map(drawn)));
  }
  // Densities, colours, directions, the table, and distances.
  assert.ok(volumes >= 4 && volumes <= 6, `${volumes} volumes`);
  assert.deepEqual(scenes.wrong(), []);
});

/** What Reinhard's tone mapping makes of a picture with colours as on a display. */
function toneMapped(pixels: number[]): number[] {
  const linear = (value: number) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  const display = (value: number) => 255 * (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);
  return pixels.map((value, at) => (at % 4 === 3 ? value : display(linear(value) / (1 + linear(value)))));
}

test("post-processing takes a field as part of its pass, and outputs are tone mapped and coded with all else", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { THREE, TSL, RenderPipeline, SIZE, sceneOf, rendererOf, cameraAt, load, picture, read } = window.gpu;
    const { scene, field } = sceneOf(address);
    const renderer = await rendererOf("webgpu");
    const camera = cameraAt([3.5, 0.8, 0]);
    await load(renderer, scene, camera);
    const plain = await picture(renderer, scene, camera);
    // In place of the canvas.
    const output = new THREE.WebGLRenderTarget(SIZE, SIZE);
    renderer.setOutputRenderTarget(output);
    renderer.setRenderTarget(output);
    renderer.render(scene, camera);
    const direct = await read(renderer, output);
    renderer.toneMapping = THREE.ReinhardToneMapping;
    renderer.render(scene, camera);
    const mapped = await read(renderer, output);
    renderer.toneMapping = THREE.NoToneMapping;
    const pipeline = new RenderPipeline(renderer, TSL.pass(scene, camera));
    pipeline.render();
    const passed = await read(renderer, output);
    renderer.setOutputRenderTarget(null);
    renderer.setRenderTarget(null);
    field.dispose();
    await renderer.dispose();
    return { plain: plain.pixels, direct, mapped, passed };
  }, scenes.harmonics);
  assert.ok(psnr(told.direct, told.plain) > 45, `on a canvas: ${psnr(told.direct, told.plain)} dB`);
  assert.ok(psnr(told.passed, told.plain) > 45, `by a pass: ${psnr(told.passed, told.plain)} dB`);
  const wanted = toneMapped(told.plain);
  assert.ok(psnr(told.mapped, wanted) > 40, `tone mapped: ${psnr(told.mapped, wanted)} dB`);
  assert.deepEqual(scenes.wrong(), []);
});

test("with WebGL, a composer draws a field in its pass, and its last pass tone maps it with all else", async () => {
  const [plain, composed, mapped] = await scenes.page.evaluate(async (address) => {
    const { EffectComposer, OutputPass, RenderPass, THREE, SIZE, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const { scene, field } = sceneOf(address);
    const renderer = await rendererOf("webgl");
    const camera = cameraAt([3.5, 0.8, 0]);
    await load(renderer, scene, camera);
    const pictures = [(await picture(renderer, scene, camera)).pixels];
    const composer = new EffectComposer(renderer);
    composer.addPass(new RenderPass(scene, camera));
    composer.addPass(new OutputPass());
    for (const toneMapping of [THREE.NoToneMapping, THREE.ReinhardToneMapping]) {
      renderer.toneMapping = toneMapping;
      composer.render();
      const gl = renderer.getContext() as WebGL2RenderingContext;
      const pixels = new Uint8Array(4 * SIZE * SIZE);
      gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      // Rows from the top.
      pictures.push(Array.from({ length: SIZE }, (_, row) => Array.from(pixels.subarray(4 * SIZE * (SIZE - 1 - row), 4 * SIZE * (SIZE - row)))).flat());
    }
    composer.dispose();
    field.dispose();
    renderer.dispose();
    return pictures;
  }, scenes.harmonics);
  assert.ok(new Set(plain).size > 50, "something is to be seen");
  assert.ok(psnr(composed, plain) > 45, `by a composer: ${psnr(composed, plain)} dB`);
  const wanted = toneMapped(plain);
  assert.ok(psnr(mapped, wanted) > 40, `tone mapped: ${psnr(mapped, wanted)} dB`);
  assert.deepEqual(scenes.wrong(), []);
});

night("fog, clipping planes and opacity do not change a field, and materials of passes leave it out", async () => {
  const told = await scenes.page.evaluate(async (address) => {
    const { ClippingGroup, THREE, sceneOf, rendererOf, cameraAt, load, picture } = window.gpu;
    const all = [];
    for (const kind of ["webgl", "webgpu"] as const) {
      const { scene, field } = sceneOf(address);
      const renderer = await rendererOf(kind);
      const camera = cameraAt([3.5, 0.8, 0]);
      await load(renderer, scene, camera);
      const pictures = [await picture(renderer, scene, camera)];
      scene.fog = new THREE.Fog(0xff0000, 0.1, 3);
      field.material.opacity = 0.3;
      const plane = new THREE.Plane(new THREE.Vector3(0, 1, 0), 0);
      if (kind === "webgl") renderer.clippingPlanes = [plane];
      else {
        const group = new ClippingGroup();
        group.clippingPlanes = [plane];
        scene.add(group.add(field));
      }
      pictures.push(await picture(renderer, scene, camera));
      renderer.clippingPlanes = [];
      scene.fog = null;
      scene.overrideMaterial = new THREE.MeshBasicMaterial({ color: 0x00ff00 });
      pictures.push(await picture(renderer, scene, camera));
      scene.overrideMaterial = null;
      pictures.push(await picture(renderer, scene, camera));
      all.push(pictures);
      field.dispose();
      await renderer.dispose();
    }
    return all;
  }, scenes.harmonics);
  same(told);
  for (const [plain, changed, passed, again] of told) {
    assert.ok(drawn(plain) > 500);
    assert.ok(psnr(plain.pixels, changed.pixels) > 60 && psnr(plain.pixels, again.pixels) > 60);
    assert.equal(drawn(passed), 0);
  }
  assert.deepEqual(scenes.wrong(), []);
});

test("with WebGL, a canvas shows a field's colours as trained, whatever the tone mapping", async () => {
  const [plain, mapped, background] = await scenes.page.evaluate(async (address) => {
    const { THREE, SIZE, sceneOf, rendererOf, cameraAt, load } = window.gpu;
    const { scene, field } = sceneOf(address);
    const renderer = await rendererOf("webgl");
    const camera = cameraAt([3.5, 0.8, 0]);
    await load(renderer, scene, camera);
    const canvas = () => {
      renderer.render(scene, camera);
      const gl = renderer.getContext() as WebGL2RenderingContext;
      const pixels = new Uint8Array(4 * SIZE * SIZE);
      gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      return Array.from(pixels);
    };
    const pictures = [canvas()];
    renderer.toneMapping = THREE.ReinhardToneMapping;
    pictures.push(canvas());
    field.visible = false;
    pictures.push(canvas());
    field.dispose();
    renderer.dispose();
    return pictures;
  }, scenes.harmonics);
  assert.deepEqual(mapped, plain);
  assert.ok(psnr(plain, background) < 30);
  assert.deepEqual(scenes.wrong(), []);
});
