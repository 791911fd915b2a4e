/** Fields that come and go leave nothing on the device, with WebGPU and with WebGL. */

import assert from "node:assert/strict";
import { scenesOfPage } from "./scenesOfPage.js";
import { night } from "./support.js";

const scenes = scenesOfPage();

night("fifty fields come and go without a trace on the device, with WebGPU", async () => {
  const { held, levels } = await scenes.page.evaluate(async (address) => {
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
  }, scenes.harmonics);
  assert.equal(levels, 50);
  assert.deepEqual(held.at(-1), held[4], `${held.join(" | ")}`);
  assert.deepEqual(scenes.wrong(), []);
});

night("with WebGL, fifty fields come and go without a trace on the device", async () => {
  const { held, levels } = await scenes.page.evaluate(async (address) => {
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
  }, scenes.harmonics);
  assert.equal(levels, 50);
  assert.deepEqual(held.at(-1), held[4], `${held.join(" | ")}`);
  assert.deepEqual(scenes.wrong(), []);
});
