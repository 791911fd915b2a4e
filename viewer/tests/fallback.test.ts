/** Assets in viewers that do not know the extension: they show the mesh, and never ask for the container. */

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before } from "node:test";
import type { Browser } from "playwright-core";
import { CountingServer, launch, newPage, night, openOther, pixels, program, psnr, ROOT, temporaryFolder, views } from "./support.js";
import { glb } from "./glb.js";
import type { Look } from "./others/asked.js";

const LEGO = join(ROOT, "fixtures", "trained", "lego64");
const CAMERAS = join(LEGO, "transforms_test.json");
const SIZE = 200;
/** Nothing in the scenes has this colour. */
const BACKGROUND: Look["background"] = [1, 0, 1];
const VIEWERS = ["three", "babylon"];
type Camera = Pick<Look, "position" | "target" | "angle">;
const folder = temporaryFolder();
const at = (name: string) => join(folder.path, name);
const server = new CountingServer();
let browser: Browser;

before(async () => {
  const bake = ["bake", join(LEGO, "fine_last.tar"), "--stepsize", "0.5", "-o", at("field.mipvog"), "--force", "--gltf"];
  program(...bake, at("inside.glb"));
  program(...bake, at("beside.gltf"));
  writeFileSync(at("theirs.glb"), theirs());
  program("attach", at("theirs.glb"), at("field.mipvog"), "--node", "0", "-o", at("attached.glb"));
  program("attach", at("theirs.glb"), at("field.mipvog"), "--external", "-o", at("added.glb"));
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

/** Somebody's asset: a square of two colours, in a plane that the camera sees. */
function theirs(): Buffer {
  const corners = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0];
  const binary = Buffer.concat([Buffer.from(new Float32Array(corners).buffer), Buffer.from(new Uint16Array([0, 1, 2, 0, 2, 3]).buffer)]);
  const unlit = (color: number[]) => ({ doubleSided: true, pbrMetallicRoughness: { baseColorFactor: color }, extensions: { KHR_materials_unlit: {} } });
  const primitive = (indices: number, material: number) => ({ attributes: { POSITION: 0 }, indices, material });
  return glb(
    {
      asset: { version: "2.0" },
      extensionsUsed: ["KHR_materials_unlit"],
      scene: 0,
      scenes: [{ nodes: [0] }],
      nodes: [{ name: "square", mesh: 0 }],
      meshes: [{ primitives: [primitive(1, 0), primitive(2, 1)] }],
      materials: [unlit([1, 0, 0, 1]), unlit([0, 1, 0, 1])],
      accessors: [
        { bufferView: 0, componentType: 5126, count: 4, type: "VEC3", min: [-1, -1, 0], max: [1, 1, 0] },
        { bufferView: 1, componentType: 5123, count: 3, type: "SCALAR" },
        { bufferView: 1, byteOffset: 6, componentType: 5123, count: 3, type: "SCALAR" },
      ],
      bufferViews: [
        { buffer: 0, byteLength: 48 },
        { buffer: 0, byteOffset: 48, byteLength: 12 },
      ],
      buffers: [{ byteLength: 60 }],
    },
    binary,
  );
}

/** An asset of the folder as a viewer shows it. */
async function drawn(viewer: string, name: string, camera: Camera, size = SIZE, background = BACKGROUND): Promise<number[]> {
  const { page, problems } = await newPage(browser);
  const asked: string[] = [];
  page.on("request", (request) => asked.push(new URL(request.url()).pathname));
  await openOther(page, server, viewer);
  const address = server.offer(name, readFileSync(at(name)));
  const picture = await page.evaluate((look) => window.draw(look), { ...camera, address, size, background });
  assert.deepEqual(problems, [], `${viewer}: ${name}`);
  assert.deepEqual(asked.filter((path) => path.endsWith(".mipvog")), []);
  await page.close();
  return picture;
}

/** The pixels that are further than `least` from the background in some channel. */
function covered(picture: number[], least: number): boolean[] {
  const far = (pixel: number, channel: number) => Math.abs(picture[4 * pixel + channel] - 255 * BACKGROUND[channel]);
  return Array.from({ length: picture.length / 4 }, (_, pixel) => Math.max(far(pixel, 0), far(pixel, 1), far(pixel, 2)) > least);
}

const count = (pixels: boolean[]) => pixels.filter(Boolean).length;

for (const name of ["inside.glb", "beside.gltf"]) {
  night(`stock viewers show the mesh of ${name} where the field is, in its colours`, async () => {
    const [view] = views(CAMERAS, SIZE);
    program("render", at("field.mipvog"), "--cameras", CAMERAS, "--frames", "0", "--size", `${SIZE}x${SIZE}`, "--background", BACKGROUND.join(), "--force", "-o", at("reference"));
    const { page } = await newPage(browser);
    const field = await pixels(page, join(at("reference"), "r_0.s1.png"));
    await page.close();
    // The asset's node turns training's z to y.
    const turned = ([x, y, z]: number[]): [number, number, number] => [x, z, -y];
    const column = (number: number) => view.toWorld.slice(0, 3).map((row) => row[number]);
    const position = turned(column(3));
    const target = turned(column(2)).map((back, axis) => position[axis] - back) as [number, number, number];
    const pictures = [];
    for (const viewer of VIEWERS) {
      const picture = await drawn(viewer, name, { position, target, angle: 2 * Math.atan((0.5 * SIZE) / view.focal) });
      const [mesh, fog] = [covered(picture, 0), covered(field, 64)];
      const both = mesh.map((is, pixel) => is && fog[pixel]);
      const either = mesh.map((is, pixel) => is || fog[pixel]);
      const overlap = count(both) / count(either);
      let difference = 0;
      both.forEach((is, pixel) => {
        for (let at = 4 * pixel; is && at < 4 * pixel + 3; at++) difference += Math.abs(picture[at] - field[at]) / 255 / 3 / count(both);
      });
      // The mesh is made for its silhouette, and has colours a vertex; the field's picture has the network's, too.
      assert.ok(overlap > 0.9, `${viewer}: ${overlap} of the silhouette`);
      assert.ok(difference < 0.12, `${viewer}: colours are ${difference} away`);
      pictures.push(picture);
    }
    const likeness = psnr(pictures[0], pictures[1]);
    assert.ok(likeness > 30, `${likeness} dB from one viewer to the other`);
  });
}

night("the mesh looks as the field does, at least 24 dB near", async () => {
  const [size, frames] = [400, [0, 4, 8]];
  const cameras = views(CAMERAS, size);
  const render = ["render", at("field.mipvog"), "--cameras", CAMERAS, "--frames", frames.join(), "--size", `${size}x${size}`, "--background", "1,1,1"];
  program(...render, "-o", at("near"));
  const names: string[] = JSON.parse(readFileSync(CAMERAS, "utf8")).frames.map((frame: { file_path: string }) => frame.file_path.split("/").pop());
  let sum = 0;
  for (const number of frames) {
    const { page } = await newPage(browser);
    const field = await pixels(page, join(at("near"), `${names[number]}.s1.png`));
    await page.close();
    const { toWorld, focal } = cameras[number];
    const turned = ([x, y, z]: number[]): [number, number, number] => [x, z, -y];
    const column = (number: number) => toWorld.slice(0, 3).map((row) => row[number]);
    const position = turned(column(3));
    const target = turned(column(2)).map((back, axis) => position[axis] - back) as [number, number, number];
    const camera = { position, target, angle: 2 * Math.atan((0.5 * size) / focal) };
    sum += psnr(await drawn("three", "inside.glb", camera, size, [1, 1, 1]), field);
  }
  assert.ok(sum / frames.length >= 24, `${sum / frames.length} dB`);
});

night("a field in somebody's asset changes nothing for viewers that do not know it", async () => {
  for (const viewer of VIEWERS) {
    const look: Camera = { position: [0.5, 0.5, 4], target: [0, 0, 0], angle: 0.8 };
    const before = await drawn(viewer, "theirs.glb", look);
    const colors = new Set(before.flatMap((_, i) => (i % 4 === 0 ? [before.slice(i, i + 3).join()] : [])));
    for (const color of ["255,0,0", "0,255,0", "255,0,255"]) assert.ok(colors.has(color), `${viewer}: ${color}`);
    for (const name of ["attached.glb", "added.glb"]) {
      assert.deepEqual(await drawn(viewer, name, look), before, `${viewer}: ${name}`);
    }
  }
});
