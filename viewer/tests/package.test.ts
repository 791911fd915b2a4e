/** The package as users get it: packed, installed from disk, and in the pages of `examples/`; three.js old and new. */

import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { cpSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import type { AddressInfo } from "node:net";
import { extname, join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import * as esbuild from "esbuild";
import * as vite from "vite";
import * as viteMiddle from "vite-middle";
import * as viteOldest from "vite-oldest";
import type {} from "../src/element.js";
import { withDraco, withKtx2, withMeshopt } from "./compressed.js";
import { npm, packed, showsAt } from "./installed.js";
import { CountingServer, launch, newPage, night, openOther, program, psnr, ROOT, temporaryFolder } from "./support.js";

/** Below `viewer/`, so that three.js and the frameworks are found there. */
const USER = join(process.cwd(), "build", "user");
const TINY = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
const server = new CountingServer();
let browser: Browser;

before(async () => {
  rmSync(USER, { recursive: true, force: true });
  mkdirSync(USER, { recursive: true });
  const tarball = packed(USER);
  writeFileSync(join(USER, "package.json"), '{ "private": true, "type": "module" }');
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
async function serve(page: Page, folder: string, headers: Record<string, string> = {}): Promise<string> {
  const types: Record<string, string> = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css" };
  await page.route(/^http:\/\/user\.test\//, async (route) => {
    const path = new URL(route.request().url()).pathname;
    const places = [folder, USER, process.cwd()].map((place) => join(place, path));
    const file = places.find((place) => extname(place) !== "" && existsSync(place));
    if (!file) return route.fulfill({ status: path === "/favicon.ico" ? 204 : 404 });
    const contentType = types[extname(file)] ?? "application/octet-stream";
    await route.fulfill({ status: 200, headers, contentType, body: readFileSync(file) });
  });
  return "http://user.test";
}

async function shows(folder: string, name: string, headers?: Record<string, string>): Promise<void> {
  const { page, problems } = await newPage(browser, { width: 300, height: 200 });
  const asked: string[] = [];
  page.on("request", (request) => asked.push(new URL(request.url()).pathname));
  await showsAt(page, problems, `${await serve(page, folder, headers)}/${name}`, "error");
  // Nothing is asked for twice, but what every worker starts from.
  const twice = asked.filter((path, at) => asked.indexOf(path) !== at && !path.includes("worker"));
  assert.deepEqual(twice, [], name);
}

test("the tarball holds the licence, and nothing that it needs but the frameworks", () => {
  const installed = join(USER, "node_modules", "mipvog-viewer");
  const { dependencies, peerDependencies } = JSON.parse(readFileSync(join(installed, "package.json"), "utf8"));
  assert.deepEqual([dependencies, Object.keys(peerDependencies)], [undefined, ["@babylonjs/core", "@babylonjs/loaders", "three"]]);
  assert.match(readFileSync(join(installed, "LICENSE"), "utf8"), /MIT/);
  for (const name of ["index", "element", "babylon", "worker"]) {
    const { sources, sourcesContent } = JSON.parse(readFileSync(join(installed, "build", "package", `${name}.js.map`), "utf8"));
    assert.equal(sourcesContent.length, sources.length, name);
  }
  // A package's page knows no other folders.
  assert.doesNotMatch(readFileSync(join(installed, "README.md"), "utf8"), /\]\((?!https:|#)/);
});

test("the package's files and types are what bundlers and Node.js look for", () => {
  const run = (name: string, ...parameters: string[]) => spawnSync("node", [join(process.cwd(), "node_modules", name), ...parameters], { encoding: "utf8" });
  const tarball = join(USER, readdirSync(USER).find((name) => name.endsWith(".tgz"))!);
  const linted = run("publint/src/cli.js", "run", tarball, "--strict");
  assert.equal(linted.status, 0, linted.stdout);
  // The worker is a script alone.
  const typed = run("@arethetypeswrong/cli/dist/index.js", tarball, "--profile", "esm-only", "--exclude-entrypoints", "worker.js", "--no-emoji");
  assert.equal(typed.status, 0, typed.stdout);
});

test("the one script of the package needs no other file but the scene", async () => {
  const { page, problems } = await newPage(browser, { width: 300, height: 200 });
  const asked: string[] = [];
  page.on("request", (request) => asked.push(new URL(request.url()).pathname));
  page.on("requestfailed", (request) => problems.push(`error: ${request.url()} ${request.failure()!.errorText}`));
  await showsAt(page, problems, `${await serve(page, USER)}/standalone.html`, "");
  assert.deepEqual(asked.filter((path) => path.startsWith("/") && !path.endsWith(".mipvog") && path !== "/favicon.ico"), ["/standalone.html", "/node_modules/mipvog-viewer/build/package/mipvog-viewer.js"]);
});

for (const name of ["import-map.html", "element.html", "model-viewer.html"]) {
  (name === "import-map.html" ? test : night)(`the example ${name} shows the scene`, () => shows(USER, name));
}

for (const name of ["vite", "react", "babylon"]) {
  (name === "vite" ? test : night)(`the example ${name}/ is built and shows the scene`, async () => {
    const root = join(USER, name);
    await vite.build({ root, configFile: false, logLevel: "error", build: { outDir: "dist" } });
    await shows(join(root, "dist"), "index.html");
  });
}

for (const [release, { createServer }] of Object.entries({ 5: viteOldest, 7: viteMiddle, 8: vite })) {
  for (const name of ["vite", "react", "babylon"]) {
    night(`the example ${name}/ shows the scene while it is developed with Vite ${release}`, async () => {
      const root = join(USER, name);
      cpSync(join(USER, "scene.mipvog"), join(root, "scene.mipvog"));
      const options = { root, cacheDir: join(USER, "cache", `${name}.${release}`), configFile: false, logLevel: "error", server: { host: "127.0.0.1", port: 0 } } as const;
      const server = await createServer(options);
      try {
        await server.listen();
        const { page, problems } = await newPage(browser, { width: 300, height: 200 });
        const { port } = server.httpServer!.address() as AddressInfo;
        // The browser tells of a worker that is not there before the text of it is taken.
        await showsAt(page, problems, `http://127.0.0.1:${port}/`, "page error");
      } finally {
        await server.close();
      }
    });
  }
}

test("a page of React that a server has drawn is taken over by the browser in strict mode, and shows the scene", async () => {
  const root = join(USER, "next");
  writeFileSync(join(root, "main.jsx"), 'import { StrictMode } from "react"; import { hydrateRoot } from "react-dom/client"; import Page from "./page.jsx"; hydrateRoot(document.getElementById("root"), <StrictMode><Page /></StrictMode>);');
  writeFileSync(join(root, "server.jsx"), 'import { renderToString } from "react-dom/server"; import "mipvog-viewer/element"; import Page from "./page.jsx"; console.log(renderToString(<Page />));');
  await esbuild.build({ entryPoints: [join(root, "server.jsx")], bundle: true, format: "esm", platform: "node", packages: "external", jsx: "automatic", outfile: join(root, "server.mjs"), logLevel: "error" });
  const drawn = execFileSync("node", [join(root, "server.mjs")], { encoding: "utf8" }).trim();
  assert.equal(drawn, '<mipvog-viewer src="scene.mipvog" alt="A toy digger"></mipvog-viewer>');
  writeFileSync(join(root, "index.html"), `<!doctype html><div id="root">${drawn}</div><script type="module" src="main.jsx"></script>`);
  await vite.build({ root, configFile: false, logLevel: "error", build: { outDir: "dist" } });
  await shows(join(root, "dist"), "index.html");
});

night("a bundle of one script, without the worker beside it, shows the scene", async () => {
  const root = join(USER, "one");
  mkdirSync(root, { recursive: true });
  await esbuild.build({ entryPoints: [join(USER, "vite", "main.js")], bundle: true, format: "esm", outfile: join(root, "main.js"), logLevel: "error" });
  cpSync(join(USER, "vite", "index.html"), join(root, "index.html"));
  const { page, problems } = await newPage(browser, { width: 300, height: 200 });
  await showsAt(page, problems, `${await serve(page, root)}/index.html`, "page error");
});

night("a page that requires trusted types names the package's, and one that does not is told to", async () => {
  const policy = (types: string) => ({ "Content-Security-Policy": `worker-src 'self'; require-trusted-types-for 'script'; trusted-types ${types}` });
  const { page: named, problems } = await newPage(browser, { width: 300, height: 200 });
  await showsAt(named, problems, `${await serve(named, USER, policy("mipvog-viewer"))}/element.html`, "page error");
  // By the first try, which tells that the page requires them.
  assert.equal(problems.filter((problem) => problem.includes("TrustedScriptURL")).length, 1);
  const { page } = await newPage(browser, { width: 300, height: 200 });
  await page.goto(`${await serve(page, USER, policy("other"))}/element.html`);
  const message = page.locator("mipvog-viewer p");
  await message.waitFor();
  assert.match(await message.innerText(), /knows no trusted types of mipvog-viewer.*Add mipvog-viewer to trusted-types/);
  await page.close();
});

test("servers that draw pages import all of it", () => {
  const all = '["mipvog-viewer", "mipvog-viewer/element", "mipvog-viewer/webgpu", "mipvog-viewer/babylon", "mipvog-viewer/standalone"]';
  const script = `import manifest from "mipvog-viewer/package.json" with { type: "json" }; const all = await Promise.all(${all}.map((name) => import(name))); console.log(manifest.name, all.map((one) => Object.keys(one).length > 0).join());`;
  const told = execFileSync("node", ["--input-type=module", "--no-warnings", "--eval", script], { cwd: USER, encoding: "utf8" });
  assert.equal(told.trim(), "mipvog-viewer true,true,true,true,true");
});

/** What TypeScript says of a script in a folder. */
function typed(folder: string, name: string, script: string, options: object): string {
  writeFileSync(join(folder, name), script);
  const compilerOptions = { target: "es2022", module: "esnext", moduleResolution: "bundler", strict: true, noEmit: true, types: [], ...options };
  writeFileSync(join(folder, "tsconfig.json"), JSON.stringify({ compilerOptions, files: [name] }));
  const { stdout } = spawnSync("node", [join(process.cwd(), "node_modules", "typescript", "bin", "tsc"), "-p", folder], { encoding: "utf8" });
  return stdout;
}

test("TypeScript knows the element in pages and in JSX, and the field in react-three-fiber", () => {
  const script = `
    import "mipvog-viewer/element";
    import type { RadianceField } from "mipvog-viewer";
    import { useRef } from "react";
    import { Canvas } from "@react-three/fiber";
    const element = document.querySelector("mipvog-viewer");
    if (element) [element.src, element.background, element.alt] = ["scene.mipvog", "transparent", element.fields[0]?.name ?? ""];
    export const Page = () => {
      const field = useRef<RadianceField>(null);
      return <><mipvog-viewer src="scene.mipvog" alt="A digger" className="wide" />
        <Canvas><radianceField ref={field} args={["scene.mipvog"]} rotation-x={1} showLevels /></Canvas></>;
    };`;
  const options = { jsx: "react-jsx", skipLibCheck: true };
  assert.equal(typed(USER, "page.tsx", script, options), "");
  assert.match(typed(USER, "page.tsx", script.replace("showLevels", "shownLevels"), options), /shownLevels/);
});

night("the package's types are sound where there is neither React nor Babylon.js", () => {
  const { path, remove } = temporaryFolder();
  for (const name of ["three", "@types/three", "@types/stats.js", "@types/webxr", "@tweenjs/tween.js", "@dimforge/rapier3d-compat", "@webgpu/types", "fflate", "meshoptimizer"]) {
    const from = join(process.cwd(), "node_modules", name);
    if (existsSync(from)) cpSync(from, join(path, "node_modules", name), { recursive: true });
  }
  cpSync(join(USER, "node_modules", "mipvog-viewer"), join(path, "node_modules", "mipvog-viewer"), { recursive: true });
  const found = typed(path, "page.ts", 'import { MipvogViewer } from "mipvog-viewer/element"; export const element: MipvogViewer = document.createElement("mipvog-viewer");', {});
  remove();
  // Types of three.js have faults of their own.
  assert.deepEqual(found.split("\n").filter((line) => line.includes("error") && !line.includes("node_modules/@types/three")), []);
});

night("the element of the package shows compressed assets, and says what it leaves out", async () => {
  const element = readFileSync(join(USER, "element.html"), "utf8");
  const assets = { draco: await withDraco(), meshopt: await withMeshopt("EXT_meshopt_compression"), ktx2: withKtx2() };
  for (const [name, bytes] of Object.entries(assets)) {
    writeFileSync(join(USER, `${name}.glb`), bytes);
    writeFileSync(join(USER, `${name}.html`), element.replace("scene.mipvog", `${name}.glb`));
    const { page } = await newPage(browser, { width: 300, height: 200 });
    await page.goto(`${await serve(page, USER)}/${name}.html`);
    await page.waitForFunction(() => document.querySelector("mipvog-viewer")?.stage?.scene.getObjectByName("floor"));
    const message = await page.evaluate(async () => {
      const element = document.querySelector("mipvog-viewer")!;
      await Promise.all(element.fields.map((field) => field.finished));
      return element.shadowRoot!.querySelector("p span")!.textContent;
    });
    if (name === "ktx2") assert.match(message!, /Basis Universal/);
    else assert.equal(message, "");
    await page.close();
  }
});

test("no example is longer than 20 lines", () => {
  for (const name of readdirSync("examples", { recursive: true, encoding: "utf8" })) {
    if (extname(name) === "") continue;
    const lines = readFileSync(join("examples", name), "utf8").trimEnd().split("\n").length;
    assert.ok(lines <= 20, `${name}: ${lines} lines`);
  }
});

night("every supported three.js draws the same picture", async () => {
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
