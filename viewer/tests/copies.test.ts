/** One field of many objects of three.js, and of several renderers. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { drawn, openStudio, type Studio } from "./studio.js";
import { night } from "./support.js";

let studio: Studio;

before(async () => {
  studio = await openStudio();
});

after(() => studio.close());

night("copies of an asset, of a scene and of a field draw the field at their own place, and it is loaded once", async () => {
  const { wanted, found, asked, workers } = await studio.page.evaluate(async (address) => {
    const { THREE, GLTFLoader, SkeletonUtils, RadianceFieldExtension, rendererOf, cameraAt, picture, fieldsIn } = window.lib;
    const loader = new GLTFLoader().register((parser) => new RadianceFieldExtension(parser));
    const { scene: asset } = await loader.loadAsync(address);
    const renderer = rendererOf();
    const camera = cameraAt([4, 2, 1]);
    const Own = Worker;
    let workers = 0;
    window.Worker = class extends Own {
      constructor(address: string | URL, options?: WorkerOptions) {
        super(address, options);
        workers++;
      }
    };
    const asked = performance.getEntriesByType("resource").length;
    const moved = async (object: import("three").Object3D) => {
      object.position.z = 0.7;
      return picture(renderer, new THREE.Scene().add(object), camera);
    };
    const wanted = await moved(asset);
    const [field] = fieldsIn(asset);
    // What drei's Clone makes of a mesh.
    const plain = new THREE.Mesh(field.geometry, field.material);
    plain.quaternion.copy(field.quaternion);
    const bare = field.clone();
    const fromField = new window.lib.RadianceField(field).copy(field);
    const early = asset.clone();
    const copies = [early, SkeletonUtils.clone(asset), new THREE.Group().add(bare), new THREE.Group().add(fromField), early.clone(), new THREE.Group().add(plain), new THREE.Group().add(new THREE.Mesh(field.geometry, field.material.clone()))];
    copies.at(-1)!.children[0].quaternion.copy(field.quaternion);
    const found = [];
    for (const copy of copies) found.push(await moved(copy));
    // One after the other is given up; the last still draws.
    asset.position.z = early.position.z = 0;
    for (const copy of [asset, ...copies.slice(1)]) fieldsIn(copy).forEach((field) => field.dispose());
    found.push(await moved(early));
    fieldsIn(early).forEach((field) => field.dispose());
    window.Worker = Own;
    return { wanted, found, asked: performance.getEntriesByType("resource").length - asked, workers };
  }, studio.asset);
  assert.ok(drawn(wanted) > 500);
  found.forEach((picture, number) => assert.deepEqual(picture, wanted, `copy ${number}`));
  assert.deepEqual([asked, workers], [0, 0]);
  assert.deepEqual(studio.wrong(), []);
});

test("the device holds one set of textures for all objects of a field, until the last is given up", async () => {
  const held = await studio.page.evaluate(async (address) => {
    const { prototype } = WebGL2RenderingContext;
    const { texStorage3D, deleteTexture, createTexture } = prototype;
    const made = new Set<WebGLTexture>();
    let volumes = 0;
    prototype.createTexture = function () {
      const texture = createTexture.call(this);
      made.add(texture);
      return texture;
    };
    prototype.deleteTexture = function (texture) {
      made.delete(texture!);
      deleteTexture.call(this, texture);
    };
    prototype.texStorage3D = function (...sizes) {
      volumes++;
      texStorage3D.apply(this, sizes);
    };
    const { sceneOf, rendererOf, cameraAt, picture } = window.lib;
    const renderer = rendererOf();
    const before = made.size;
    const { scene, field } = sceneOf(address);
    const other = field.clone();
    scene.add(other);
    await picture(renderer, scene, cameraAt([4, 2, 0]));
    const held = [volumes];
    field.dispose();
    held.push(made.size - before);
    other.dispose();
    held.push(made.size - before);
    Object.assign(prototype, { texStorage3D, deleteTexture, createTexture });
    return held;
  }, studio.harmonics);
  assert.ok(held[0] >= 4 && held[0] <= 6, `${held}`);
  assert.equal(held[1], held[0]);
  assert.equal(held[2], 0);
});

test("a copy of what was given up says so", async () => {
  const message = await studio.page.evaluate(async (address) => {
    const field = new window.lib.RadianceField(address);
    await field.finished;
    field.dispose();
    const late = field.clone();
    return new Promise<string>((done) => late.addEventListener("failed", ({ error }) => done(`${error.message} ${error.remedy}`)));
  }, studio.harmonics);
  assert.match(message, /given up.*Open it again/);
});

test("a field is made of a source", async () => {
  const message = await studio.page.evaluate(() => {
    try {
      return new window.lib.RadianceField(undefined as unknown as string).name;
    } catch (error) {
      return String(error);
    }
  });
  assert.match(message, /^FieldError: A field is made of a container's address/);
});

night("two renderers show one field, and levels come once for each", async () => {
  const { pictures, sent } = await studio.page.evaluate(async (address) => {
    const { sceneOf, rendererOf, cameraAt, fieldsIn } = window.lib;
    const { scene } = sceneOf(address);
    const [field] = fieldsIn(scene);
    let again = 0;
    const { postMessage } = Worker.prototype;
    Worker.prototype.postMessage = function (this: Worker, ...parameters: unknown[]) {
      if ((parameters[0] as { kind: string }).kind === "again") again++;
      postMessage.apply(this, parameters as [unknown]);
    };
    const renderers = [rendererOf(), rendererOf()];
    const camera = cameraAt([3.6, 1, 0.5]);
    await field.opened;
    let frames = 0;
    do {
      for (const renderer of renderers) renderer.render(scene, camera);
      await new Promise((done) => setTimeout(done, 20));
      frames++;
    } while ((field.waiting || field.decoding || field.finest !== 0 || frames < 20) && frames < 500);
    for (const renderer of renderers) renderer.render(scene, camera);
    const pictures = renderers.map(window.lib.pixelsOf);
    field.dispose();
    Worker.prototype.postMessage = postMessage;
    return { pictures, sent: again };
  }, studio.lego);
  assert.equal(sent, 1);
  assert.ok(drawn(pictures[0]) > 500);
  assert.deepEqual(pictures[0], pictures[1]);
  assert.deepEqual(studio.wrong(), []);
});
