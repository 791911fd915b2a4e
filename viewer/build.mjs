/**
 * Builds the products: the page in `dist/`, which is committed and goes into the program, and with `--package` the
 * npm package in `build/package/`. With `--tests` the tests in `build/tests/`, with `--benches` the benchmarks; with `--check` the page in `build/page/`,
 * which must equal `dist/`.
 */

import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { build } from "esbuild";

/** Google's decoder of Draco comes with three.js, as a script that is no module. It is bundled, whatever is not. */
const draco = {
  name: "draco",
  setup(build) {
    const folder = `${process.cwd()}/node_modules/three/examples/jsm/libs/draco/gltf`;
    build.onResolve({ filter: /^draco$/ }, () => ({ path: `${folder}/draco_wasm_wrapper.js`, namespace: "draco" }));
    build.onResolve({ filter: /^draco\.wasm$/ }, () => ({ path: `${folder}/draco_decoder.wasm` }));
    build.onLoad({ filter: /.*/, namespace: "draco" }, ({ path }) => ({ contents: `${readFileSync(path, "utf8")}\nexport default DracoDecoderModule;` }));
    // For other places than browsers, where it would look for its files.
    build.onResolve({ filter: /^(fs|path)$/, namespace: "draco" }, ({ path }) => ({ path, external: true }));
  },
};
const common = { bundle: true, format: "esm", target: "es2022", legalComments: "none", charset: "utf8", logLevel: "warning", loader: { ".glsl": "text", ".wgsl": "text", ".txt": "text", ".wasm": "binary" }, plugins: [draco] };

// Into the bundles by its bytes: no request for it can fail.
mkdirSync("build", { recursive: true });
const options = ["-O3", "--runtime", "stub", "--enable", "simd", "--noAssert"];
for (const name of ["restore", "weave", "skip"]) {
  execFileSync("node_modules/.bin/asc", [`wasm/${name}.ts`, "--outFile", `build/${name}.wasm`, ...options], { stdio: "inherit" });
}

/** The licences of what a product contains, which they ask to be kept with it. */
function notices(...packages) {
  const texts = packages.map((name) => `${name}:\n\n${(LICENSES[name] ?? licence(name)).trim()}`);
  return { banner: { js: `/*!\nContains these packages.\n\n${texts.join("\n\n")}\n*/` } };
}
const licence = (name, file = "LICENSE") => readFileSync(`node_modules/${name}/${file}`, "utf8");
/** Those of what comes within other packages. */
const LICENSES = {
  meshoptimizer: licence("three").replace(/^Copyright.*$/m, "Copyright (c) 2016-2026 Arseny Kapoulkine"),
  "Draco, of Google": licence("@babylonjs/core", "license.md"),
};

// The worker's address is relative to its script in every product. The package has its text as well, in a script that only
// those load who cannot have the worker.
const worker = (outfile, options = {}) =>
  build({ ...common, ...notices("fzstd", "zstddec"), entryPoints: ["src/load/worker.ts"], outfile, minify: true, ...options });
/** Beside the scripts that ask for it, like the worker; `external` is what it does not contain. */
const decoders = (outfile, external = []) =>
  build({ ...common, ...notices("meshoptimizer", "Draco, of Google"), entryPoints: ["src/stage/decoders.ts"], outfile, external, minify: true });
const workerIs = (file, text) => ({ define: { HAS_WORKER_FILE: String(file), HAS_WORKER_TEXT: String(text) } });
const [withText, withoutText, onlyText] = [workerIs(true, true), workerIs(true, false), workerIs(false, true)];

if (process.argv.includes("--package")) {
  rmSync("build/package", { recursive: true, force: true });
  // What two of them need is in a file of its own, so that a page has one class of each name.
  const entryPoints = { index: "src/index.ts", element: "src/element.ts", webgpu: "src/webgpu.ts", babylon: "src/babylon/index.ts" };
  await worker("build/worker.txt");
  await worker("build/package/worker.js", { sourcemap: true });
  const external = ["three", "three/*", "@babylonjs/*"];
  await decoders("build/package/decoders.js", external);
  await build({ ...common, ...withText, entryPoints, outdir: "build/package", splitting: true, sourcemap: true, external: [...external, "./decoders.js"] });
  // One script, with everything in it.
  const all = notices("three", "fzstd", "zstddec", "meshoptimizer", "Draco, of Google");
  await build({ ...common, ...onlyText, ...all, entryPoints: ["src/standalone.ts"], outfile: "build/package/mipvog-viewer.js", minify: true });
  execFileSync("node_modules/.bin/tsc", ["--project", "tsconfig.package.json"], { stdio: "inherit" });
} else if (process.argv.includes("--benches")) {
  const entryPoints = readdirSync("benches").filter((name) => name !== "floor.ts").map((name) => `benches/${name}`);
  await build({ ...common, ...withoutText, entryPoints, outdir: "build/benches", outExtension: { ".js": ".mjs" }, platform: "node", packages: "external" });
} else if (process.argv.includes("--tests")) {
  rmSync("build/tests", { recursive: true, force: true });
  // Tests of time are named `alone`: nothing else may run beside them.
  const tests = readdirSync("tests").filter((name) => /\.(test|alone)\.ts$/.test(name));
  await build({
    ...common,
    ...withoutText,
    entryPoints: tests.map((name) => `tests/${name}`),
    outdir: "build/tests",
    outExtension: { ".js": ".mjs" },
    platform: "node",
    packages: "external",
  });
  // Scripts of pages that are somebody else's, which tests drive.
  const others = readdirSync("tests/others").filter((name) => !["asked.ts", "floor.ts"].includes(name));
  const outdir = "build/tests/others";
  await build({ ...common, ...withoutText, entryPoints: others.map((name) => `tests/others/${name}`), outdir });
  for (const release of ["oldest", "middle"]) {
    const entryPoints = [{ in: "tests/others/plugin.ts", out: `plugin.${release}` }];
    await build({ ...common, ...withoutText, entryPoints, outdir, alias: { three: `three-${release}` } });
  }
  await build({ ...common, ...withoutText, entryPoints: ["tests/others/floor.ts"], outdir, alias: { three: "three-middle" } });
  await worker("build/tests/others/worker.js");
} else {
  const out = process.argv.includes("--check") ? "build/page" : "dist";
  await build({ ...common, ...withoutText, ...notices("three"), entryPoints: ["page/viewer.ts"], outfile: `${out}/viewer.js`, minify: true, external: ["./decoders.js"] });
  await decoders(`${out}/decoders.js`);
  await worker(`${out}/worker.js`);
  await build({ ...common, entryPoints: ["page/style.css"], outfile: `${out}/style.css`, minify: true });
  copyFileSync("page/index.html", `${out}/index.html`);
}
