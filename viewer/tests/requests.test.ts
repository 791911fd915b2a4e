/** How files are asked for: by the headers, the credentials and at the addresses that their users and loaders say. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { bakedScene, CountingServer, launch, newPage, openOther, program, ROOT, temporaryFolder } from "./support.js";
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

test("fields are made of addresses, answers and bytes of every kind, and tell how much has come", async () => {
  await open("scenes");
  server.login = null;
  const ends = await page.evaluate(async (address) => {
    const bytes = await (await fetch(address)).arrayBuffer();
    const sources = [new URL(address), await fetch(address), new Blob([bytes]), bytes.slice(), new Uint8Array(bytes), new DataView(bytes)];
    const ends = [];
    for (const source of sources) {
      const field = new window.lib.RadianceField(source);
      const steps: { loaded: number; total: number }[] = [];
      field.addEventListener("progress", ({ loaded, total }) => steps.push({ loaded, total }));
      await field.finished;
      ends.push(steps.at(-1)!.loaded === bytes.byteLength && steps.at(-1)!.total === bytes.byteLength && steps.every(({ loaded, total }) => total === 0 || loaded <= total));
      field.dispose();
    }
    const wrong = [await fetch(`${address}.not`), await fetch(address)];
    await wrong[1].text();
    for (const source of wrong) ends.push(await new window.lib.RadianceField(source).opened.catch((error) => error.message));
    return ends;
  }, `${server.origin}/field.mipvog`);
  assert.deepEqual(ends.slice(0, 6), Array(6).fill(true));
  assert.match(String(ends[6]), /answers 404/);
  assert.match(String(ends[7]), /was read before/);
  await close();
});

test("a signal ends loading, and a manager of three.js hears of the first level or the failure", async () => {
  await open("scenes");
  server.login = null;
  const told = await page.evaluate(async (address) => {
    const { THREE, RadianceField } = window.lib;
    const ending = new AbortController();
    const failures: string[] = [];
    const end = (field: InstanceType<typeof RadianceField>) => {
      field.addEventListener("failed", ({ error }) => failures.push(error.message));
      return field.finished.then(() => "whole", (error) => (error as Error).name);
    };
    const ends = [end(new RadianceField(address, { signal: AbortSignal.abort() }))];
    const later = new RadianceField(address, { signal: ending.signal });
    ends.push(end(later));
    await later.opened;
    ending.abort(new RangeError());
    const whole = new AbortController();
    const kept = new RadianceField(address, { signal: whole.signal });
    ends.push(end(kept));
    await kept.finished;
    // Too late.
    whole.abort();
    const heard: string[] = [];
    const manager = new THREE.LoadingManager(() => heard.push("all"));
    manager.onError = (name) => heard.push(`no ${name.split("/").pop()}`);
    manager.setURLModifier((name) => name.replace("named", "field"));
    const managed = new RadianceField(address.replace("field", "named"), { manager });
    await new Promise((done) => managed.addEventListener("change", done));
    await new RadianceField(`${address}.not`, { manager }).opened.catch(() => {});
    new RadianceField(address, { manager }).dispose();
    return { ends: await Promise.all(ends), failures, heard };
  }, `${server.origin}/field.mipvog`);
  assert.deepEqual(told.ends, ["AbortError", "RangeError", "whole"]);
  assert.deepEqual(told.failures, ["Loading was given up.", "Loading was given up."]);
  assert.deepEqual(told.heard, ["all", "no field.mipvog.not", "all", "no field.mipvog", "all"]);
  await close();
});

test("the first picture takes two requests, none is broken off, and those that fail are made again", async () => {
  const large = readFileSync(bakedScene("lego").container);
  const address = server.offer("network.mipvog", large);
  await open("scenes");
  server.login = null;
  const failed: string[] = [];
  server.ends.length = 0;
  page.on("requestfailed", (request) => failed.push(`${request.failure()!.errorText} ${request.url()} ${request.headers().range ?? ""}`));
  const load = () => page.evaluate((address) => new window.lib.RadianceField(address).finished.then(() => "whole", (error) => error.message), address);
  assert.equal(await load(), "whole");
  const [, first] = server.ends.splice(0);
  assert.ok(first < large.length / 15, `${first} of ${large.length}`);
  await page.waitForTimeout(200);
  assert.deepEqual(failed, []);
  // Nothing else comes before it is there.
  server.gate = first;
  await page.evaluate((address) => {
    const field = new window.lib.RadianceField(address);
    Object.assign(window, { gated: field });
    return new Promise<void>((done) => field.addEventListener("change", () => done()));
  }, address);
  assert.equal(server.ends.length, 2);
  server.open(Infinity);
  // Or one of its requests would be the one that fails.
  assert.equal(await page.evaluate(() => (window as unknown as { gated: { finished: Promise<void> } }).gated.finished.then(() => "whole")), "whole");
  server.failing = 1;
  assert.equal(await load(), "whole");
  server.starts.length = 0;
  server.breaking = 1000;
  await page.evaluate((address) => {
    const field = new window.lib.RadianceField(address);
    const some = new Promise<void>((done) => field.addEventListener("progress", ({ loaded }) => loaded >= 1000 && done()));
    Object.assign(window, { broken: field });
    return some;
  }, address);
  server.snap();
  assert.equal(await page.evaluate(() => (window as unknown as { broken: { finished: Promise<void> } }).broken.finished.then(() => "whole")), "whole");
  // What came before it broke did not come again.
  assert.equal(server.starts[1], 1000);
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
