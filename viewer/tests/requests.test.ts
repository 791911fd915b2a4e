/** How files are asked for: by the headers, the credentials and at the addresses that their users and loaders say. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { CountingServer, launch, newPage, openOther, program, ROOT, temporaryFolder } from "./support.js";
import type {} from "./others/babylon.scenes.js";
import type {} from "./others/scenes.js";

const LOGIN = "Bearer 7";
const folder = temporaryFolder();
const server = new CountingServer();
let browser: Browser;
let page: Page;
let asset: string;

before(async () => {
  program("bake", join(ROOT, "fixtures", "trained", "tiny", "fine_last.tar"), "-o", join(folder.path, "field.mipvog"), "--gltf", join(folder.path, "beside.gltf"));
  await server.start();
  for (const name of ["field.mipvog", "beside.gltf", "beside.bin"]) {
    try {
      const address = server.offer(name, readFileSync(join(folder.path, name)));
      if (name.endsWith("gltf")) asset = address;
    } catch {
      // The buffer may be in the document.
    }
  }
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

async function open(name: string): Promise<void> {
  ({ page } = await newPage(browser));
  await openOther(page, server, name);
  server.login = LOGIN;
  server.asked.length = 0;
}

async function close(): Promise<void> {
  server.login = null;
  await page.close();
}

test("a field is asked for with headers and credentials of its own", async () => {
  await open("scenes");
  const ends = await page.evaluate(async (address) => {
    document.cookie = "user=7";
    const end = async (options: object) => {
      const field = new window.lib.RadianceField(address, options);
      const end = await field.finished.then(() => "whole", (error) => error.message);
      field.dispose();
      return end;
    };
    const headers = { Authorization: "Bearer 7" };
    return [await end({}), await end({ headers }), await end({ headers: new Headers(headers), credentials: "omit" })];
  }, `${server.origin}/field.mipvog`);
  assert.match(ends[0], /answers 401/);
  assert.deepEqual(ends.slice(1), ["whole", "whole"]);
  assert.deepEqual([server.asked[1].cookie, server.asked.at(-1)!.cookie], [true, false]);
  await close();
});

test("three.js: a container beside an asset is asked for as the loader asks for buffers", async () => {
  await open("scenes");
  const found = await page.evaluate(async (address) => {
    const { THREE, GLTFLoader, RadianceFieldExtension, fieldsIn } = window.lib;
    const load = async (manager: import("three").LoadingManager, headers: Record<string, string>, address: string) => {
      const loader = new GLTFLoader(manager).register((parser) => new RadianceFieldExtension(parser));
      loader.setRequestHeader(headers).setWithCredentials(true);
      const { scene } = await loader.loadAsync(address);
      const [field] = fieldsIn(scene);
      await field?.finished;
      field?.dispose();
      return field !== undefined;
    };
    const headers = { Authorization: "Bearer 7" };
    const asked = await load(new THREE.LoadingManager(), headers, address);
    // Files that were dropped: names stand for blobs.
    const blobs: Record<string, string> = {};
    for (const name of ["beside.gltf", "field.mipvog"]) {
      blobs[name] = URL.createObjectURL(await (await fetch(new URL(name, address), { headers })).blob());
    }
    const manager = new THREE.LoadingManager().setURLModifier((address) => blobs[address.split("/").pop()!] ?? address);
    return [asked, await load(manager, {}, "https://nowhere.test/beside.gltf")];
  }, asset);
  assert.deepEqual(found, [true, true]);
  await close();
});

test("Babylon.js: a container beside an asset is asked for as the loader asks for buffers", async () => {
  await open("babylon.scenes");
  const found = await page.evaluate(async (address) => {
    const { ImportMeshAsync, RadianceField, WebRequest, sceneOf } = window.babylon;
    const load = async (address: string, options: Record<string, unknown>) => {
      const { scene, engine } = sceneOf(true, [3, 1, 0]);
      const { meshes } = await ImportMeshAsync(address, scene, { pluginOptions: { gltf: options } });
      const field = meshes.find((mesh) => mesh instanceof RadianceField);
      await field?.finished;
      engine.dispose();
      return field !== undefined;
    };
    WebRequest.CustomRequestHeaders.Authorization = "Bearer 7";
    const asked = await load(address, {});
    const blob = URL.createObjectURL(await (await fetch(new URL("field.mipvog", address), { headers: { Authorization: "Bearer 7" } })).blob());
    const modified = await load(address, { preprocessUrlAsync: (address: string) => Promise.resolve(address.endsWith(".mipvog") ? blob : address) });
    return [asked, modified];
  }, asset);
  assert.deepEqual(found, [true, true]);
  assert.equal(server.asked.filter(({ path }) => path === "/field.mipvog").length > 0, true);
  await close();
});
