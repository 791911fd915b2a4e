/** Fields among what else scenes of three.js have, with WebGL and with WebGPU, which look the same: one test of each row of the README's table. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { Picture } from "./others/webgpu.js";
import { CountingServer, launchWebGPU, newPage, night, openOther, psnr, ROOT } from "./support.js";

const server = new CountingServer();
let browser: Browser;
let page: Page;
let problems: string[];
let harmonics: string;
let tiny: string;

before(async () => {
  await server.start();
  const offer = (name: string) => server.offer(`${name}.mipvog`, readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
  [harmonics, tiny] = [offer("harmonics"), offer("tiny.rate")];
  browser = await launchWebGPU();
  ({ page, problems } = await newPage(browser));
  await openOther(page, server, "webgpu");
});

after(async () => {
  await browser.close();
  server.stop();
});

function wrong(): string[] {
  return problems.splice(0);
}

const green = ({ pixels }: Picture) => pixels.filter((value, at) => at % 4 === 1 && value > 250 && pixels[at - 1] < 5).length;
const drawn = ({ pixels }: Picture) => pixels.filter((value, at) => at % 4 < 3 && value < 250).length;

/** Pictures of both renderers are the same, and their depths. */
function same([webgl, webgpu]: Picture[][], what = ""): void {
  assert.equal(webgl.length, webgpu.length);
  webgl.forEach((picture, number) => {
    const likeness = psnr(picture.pixels, webgpu[number].pixels);
    assert.ok(likeness >= 60, `${what} ${number}: ${likeness} dB`);
    const off = Math.max(0, ...picture.depths.map((depth, at) => Math.abs(depth - webgpu[number].depths[at])));
    assert.ok(off <= 1e-4, `${what} ${number}: depths ${off} apart`);
  });
}

night("opaque and transparent meshes hide a field and are hidden by it, with every kind of depth", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
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
  assert.deepEqual(wrong(), []);
});

test("a field casts no shadow and receives none", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
  same(told);
  for (const [none, cast, received] of told) {
    assert.ok(psnr(none.pixels, cast.pixels) > 60, `${psnr(none.pixels, cast.pixels)} dB with a shadow`);
    assert.ok(psnr(none.pixels, received.pixels) > 60, `${psnr(none.pixels, received.pixels)} dB under a roof`);
  }
  assert.deepEqual(wrong(), []);
});

night("fields that overlap are drawn from far to near by their origins, and one is hidden where another's depth is before its own", async () => {
  const told = await page.evaluate(async ([one, two]) => {
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
  }, [harmonics, tiny] as const);
  same(told);
  for (const pictures of told) {
    for (let at = 0; at < pictures.length; at += 3) {
      const [both, other, field] = pictures.slice(at, at + 3);
      // Depths are those of what is nearer.
      both.depths.forEach((depth, pixel) => assert.ok(Math.abs(depth - Math.min(other.depths[pixel], field.depths[pixel])) < 1e-5));
    }
  }
  assert.deepEqual(wrong(), []);
});

night("a field is drawn many times, below any parent, from one set of textures", async () => {
  const { pictures, volumes } = await page.evaluate(async (address) => {
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
  }, harmonics);
  same(pictures);
  for (const [all, ...each] of pictures) {
    assert.ok(each.every((one) => drawn(one) > 60), `${each.map(drawn)}`);
    assert.ok(drawn(all) > Math.max(...each.map(drawn)));
  }
  // Densities, colours, directions, the table, and distances.
  assert.ok(volumes >= 4 && volumes <= 6, `${volumes} volumes`);
  assert.deepEqual(wrong(), []);
});

night("orthographic cameras, far planes in the box, and targets of several samples", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
  same(told);
  for (const pictures of told) {
    assert.ok(green(pictures[0]) < green(pictures[1]));
    const [cut, whole, sampled, floats, flat] = pictures.slice(4).map(({ pixels }) => pixels);
    for (const other of [cut, sampled, floats, flat]) assert.ok(psnr(other, whole) > 40, `${psnr(other, whole)} dB`);
  }
  assert.deepEqual(wrong(), []);
});

test("post-processing takes a field as part of its pass, and outputs are tone mapped and coded with all else", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
  assert.ok(psnr(told.direct, told.plain) > 45, `on a canvas: ${psnr(told.direct, told.plain)} dB`);
  assert.ok(psnr(told.passed, told.plain) > 45, `by a pass: ${psnr(told.passed, told.plain)} dB`);
  const linear = (value: number) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  const display = (value: number) => 255 * (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);
  const wanted = told.plain.map((value, at) => (at % 4 === 3 ? value : display(linear(value) / (1 + linear(value)))));
  assert.ok(psnr(told.mapped, wanted) > 40, `tone mapped: ${psnr(told.mapped, wanted)} dB`);
  assert.deepEqual(wrong(), []);
});

test("targets of several attachments, cameras of several views and the fallback to WebGL are refused once, and the rest of the scene is drawn", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
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
  assert.deepEqual(wrong().filter((problem) => !expected.some((start) => problem.startsWith(start)) && !/is not compatible/.test(problem)), []);
});

night("fifty fields come and go without a trace on the device", async () => {
  const { held, levels } = await page.evaluate(async (address) => {
    const { RadianceField, rendererOf, cameraAt, THREE, targetOf, picture } = window.gpu;
    const held = new Map<object, number>();
    const [device, texture, buffer] = [GPUDevice.prototype, GPUTexture.prototype, GPUBuffer.prototype];
    const own = { createTexture: device.createTexture, createBuffer: device.createBuffer, texture: texture.destroy, buffer: buffer.destroy };
    device.createTexture = function (descriptor) {
      const made = own.createTexture.call(this, descriptor);
      held.set(made, 1);
      return made;
    };
    device.createBuffer = function (descriptor) {
      const made = own.createBuffer.call(this, descriptor);
      held.set(made, 1);
      return made;
    };
    texture.destroy = function () {
      held.delete(this);
      own.texture.call(this);
    };
    buffer.destroy = function () {
      held.delete(this);
      own.buffer.call(this);
    };
    const renderer = await rendererOf("webgpu");
    const camera = cameraAt([3.5, 0.8, 0]);
    const bytes = await (await fetch(address)).arrayBuffer();
    const target = targetOf({}, 8);
    const scene = new THREE.Scene();
    const counts: [number, number, number][] = [];
    let levels = 0;
    for (let cycle = 0; cycle < 50; cycle++) {
      const field = new RadianceField(bytes.slice(0));
      scene.add(field);
      await field.finished;
      renderer.setRenderTarget(target);
      for (let frame = 0; frame < 100 && (field.waiting || field.finest !== 0); frame++) renderer.render(scene, camera);
      levels += Number(field.finest === 0);
      await field.pickAsync(renderer, camera, 0.5, 0.5);
      scene.remove(field);
      field.dispose();
      renderer.render(scene, camera);
      counts.push([held.size, renderer.info.memory.geometries, renderer.info.memory.textures]);
    }
    await picture(renderer, scene, camera);
    Object.assign(device, { createTexture: own.createTexture, createBuffer: own.createBuffer });
    [texture.destroy, buffer.destroy] = [own.texture, own.buffer];
    await renderer.dispose();
    return { held: counts, levels };
  }, harmonics);
  assert.equal(levels, 50);
  assert.deepEqual(held.at(-1), held[4], `${held.join(" | ")}`);
  assert.deepEqual(wrong(), []);
});

night("fog, clipping planes and opacity do not change a field, and materials of passes leave it out", async () => {
  const told = await page.evaluate(async (address) => {
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
  }, harmonics);
  same(told);
  for (const [plain, changed, passed, again] of told) {
    assert.ok(drawn(plain) > 500);
    assert.ok(psnr(plain.pixels, changed.pixels) > 60 && psnr(plain.pixels, again.pixels) > 60);
    assert.equal(drawn(passed), 0);
  }
  assert.deepEqual(wrong(), []);
});

night("with WebGL, fifty fields come and go without a trace on the device", async () => {
  const { held, levels } = await page.evaluate(async (address) => {
    const { RadianceField, rendererOf, cameraAt, THREE, targetOf } = window.gpu;
    const { prototype } = WebGL2RenderingContext;
    const held = new Set<object>();
    const names = ["Texture", "Buffer", "VertexArray", "Framebuffer"] as const;
    type Make = () => object;
    type Free = (made: object | null) => void;
    const methods = prototype as unknown as Record<string, Make & Free>;
    const own = names.map((name): [Make, Free] => [methods[`create${name}`], methods[`delete${name}`]]);
    names.forEach((name, number) => {
      methods[`create${name}`] = function (this: WebGL2RenderingContext) {
        const made = own[number][0].call(this);
        held.add(made);
        return made;
      } as Make & Free;
      methods[`delete${name}`] = function (this: WebGL2RenderingContext, made: object | null) {
        if (made) held.delete(made);
        own[number][1].call(this, made);
      } as Make & Free;
    });
    const renderer = await rendererOf("webgl");
    const camera = cameraAt([3.5, 0.8, 0]);
    const bytes = await (await fetch(address)).arrayBuffer();
    const scene = new THREE.Scene();
    const target = targetOf({}, 8);
    const counts: [number, number, number][] = [];
    let levels = 0;
    for (let cycle = 0; cycle < 50; cycle++) {
      const field = new RadianceField(bytes.slice(0));
      scene.add(field);
      await field.finished;
      renderer.setRenderTarget(target);
      for (let frame = 0; frame < 100 && (field.waiting || field.finest !== 0); frame++) renderer.render(scene, camera);
      levels += Number(field.finest === 0);
      field.pick(renderer, camera, 0.5, 0.5);
      scene.remove(field);
      field.dispose();
      renderer.render(scene, camera);
      counts.push([held.size, renderer.info.memory.geometries, renderer.info.programs!.length]);
    }
    names.forEach((name, number) => ([methods[`create${name}`], methods[`delete${name}`]] = own[number] as unknown as [Make & Free, Make & Free]));
    renderer.dispose();
    return { held: counts, levels };
  }, harmonics);
  assert.equal(levels, 50);
  assert.deepEqual(held.at(-1), held[4], `${held.join(" | ")}`);
  assert.deepEqual(wrong(), []);
});

test("with WebGL, a headset's cameras each see the field from their place", async () => {
  const { both, left, right } = await page.evaluate(async (address) => {
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
  }, harmonics);
  const half = (number: number) => Array.from({ length: 64 }, (_, row) => both.slice(4 * (128 * row + 64 * number), 4 * (128 * row + 64 * number + 64))).flat();
  for (const [number, eye] of [left, right].entries()) assert.ok(psnr(half(number), eye) > 60, `eye ${number}: ${psnr(half(number), eye)} dB`);
  assert.ok(psnr(left, right) < 40);
  assert.deepEqual(wrong(), []);
});

test("with WebGL, a canvas shows a field's colours as trained, whatever the tone mapping", async () => {
  const [plain, mapped, background] = await page.evaluate(async (address) => {
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
  }, harmonics);
  assert.deepEqual(mapped, plain);
  assert.ok(psnr(plain, background) < 30);
  assert.deepEqual(wrong(), []);
});
