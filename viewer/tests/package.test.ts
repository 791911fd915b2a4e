/** The package as users get it: packed, installed from disk, and in the pages of `examples/`; three.js old and new. */

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { extname, join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { build } from "vite";
import { CountingServer, launch, newPage, openOther, program, psnr, ROOT } from "./support.js";

/** Below `viewer/`, so that three.js and the frameworks are found there. */
const USER = join(process.cwd(), "build", "user");
const TINY = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
const server = new CountingServer();
let browser: Browser;

before(async () => {
  rmSync(USER, { recursive: true, force: true });
  mkdirSync(USER, { recursive: true });
  const npm = (folder: string, ...parameters: string[]) => execFileSync("npm", parameters, { cwd: folder, encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] });
  npm(process.cwd(), "pack", "--pack-destination", USER);
  writeFileSync(join(USER, "package.json"), '{ "private": true, "type": "module" }');
  const tarball = readdirSync(USER).find((name) => name.endsWith(".tgz"))!;
  // What else it needs is installed already, so that nothing is fetched.
  npm(USER, "install", "--offline", "--legacy-peer-deps", "--no-audit", "--no-fund", `./${tarball}`);
  cpSync("examples", USER, { recursive: true });
  program("bake", join(ROOT, "fixtures", "trained", "tiny", "fine_last.tar"), "-o", join(USER, "scene.mipvog"), "--gltf", join(USER, "scene.glb"));
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

/** Answers what the browser asks for from a folder, and packages from where they are installed. */
async function serve(page: Page, folder: string): Promise<string> {
  const types: Record<string, string> = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css" };
  await page.route(/^http:\/\/user\.test\//, async (route) => {
    const path = new URL(route.request().url()).pathname;
    const places = [folder, USER, process.cwd()].map((place) => join(place, path));
    const file = places.find((place) => extname(place) !== "" && existsSync(place));
    if (!file) return route.fulfill({ status: path === "/favicon.ico" ? 204 : 404 });
    const contentType = types[extname(file)] ?? "application/octet-stream";
    await route.fulfill({ status: 200, contentType, body: readFileSync(file) });
  });
  return "http://user.test";
}

/** How many colours the page shows. */
async function colors(page: Page): Promise<number> {
  const data = (await page.screenshot()).toString("base64");
  return page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    return new Set(new Uint32Array(context.getImageData(0, 0, picture.width, picture.height).data.buffer)).size;
  }, data);
}

async function shows(folder: string, name: string): Promise<void> {
  const { page, problems } = await newPage(browser, { width: 300, height: 200 });
  await page.goto(`${await serve(page, folder)}/${name}`);
  const end = Date.now() + 60_000;
  while ((await colors(page)) < 100) assert.ok(Date.now() < end, `${name} shows nothing: ${problems}`);
  // Warnings are the frameworks' own, of their habits and of slow machines.
  assert.deepEqual(problems.filter((problem) => problem.includes("error")), [], name);
  await page.close();
}

test("the tarball holds the licence, and nothing that it needs but the frameworks", () => {
  const installed = join(USER, "node_modules", "mipvog-viewer");
  const { dependencies, peerDependencies } = JSON.parse(readFileSync(join(installed, "package.json"), "utf8"));
  assert.deepEqual([dependencies, Object.keys(peerDependencies)], [undefined, ["@babylonjs/core", "@babylonjs/loaders", "three"]]);
  assert.match(readFileSync(join(installed, "LICENSE"), "utf8"), /MIT/);
  // A package's page knows no other folders.
  assert.doesNotMatch(readFileSync(join(installed, "README.md"), "utf8"), /\]\((?!https:|#)/);
});

for (const name of ["import-map.html", "element.html", "model-viewer.html"]) {
  test(`the example ${name} shows the scene`, () => shows(USER, name));
}

for (const name of ["vite", "react", "babylon"]) {
  test(`the example ${name}/ is built and shows the scene`, async () => {
    const root = join(USER, name);
    await build({ root, configFile: false, logLevel: "error", build: { outDir: "dist" } });
    await shows(join(root, "dist"), "index.html");
  });
}

test("no example is longer than 20 lines", () => {
  for (const name of readdirSync("examples", { recursive: true, encoding: "utf8" })) {
    if (extname(name) === "") continue;
    const lines = readFileSync(join("examples", name), "utf8").trimEnd().split("\n").length;
    assert.ok(lines <= 20, `${name}: ${lines} lines`);
  }
});

test("every supported three.js draws the same picture", async () => {
  const address = server.offer("tiny.mipvog", readFileSync(TINY));
  const pictures = [];
  for (const name of ["plugin.oldest", "plugin.middle", "plugin"]) {
    const { page, problems } = await newPage(browser);
    await openOther(page, server, name);
    pictures.push(await page.evaluate((address) => window.drawField(address), address));
    // Older releases warn of what newer ones do otherwise.
    assert.deepEqual(problems.filter((problem) => problem.includes("error")), [], name);
    await page.close();
  }
  assert.ok(new Set(pictures[0]).size > 50, "something is to be seen");
  for (const picture of pictures) assert.ok(psnr(picture, pictures[2]) > 50);
});
