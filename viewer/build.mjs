/**
 * Builds the two products: the page in `dist/`, which is committed and goes into the program, and with `--package` the
 * npm package in `build/package/`. With `--tests` the tests in `build/tests/`, with `--benches` the benchmarks; with `--check` the page in `build/page/`,
 * which must equal `dist/`.
 */

import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { build } from "esbuild";

const common = { bundle: true, format: "esm", target: "es2022", legalComments: "none", charset: "utf8", logLevel: "warning", loader: { ".glsl": "text", ".txt": "text", ".wasm": "binary" } };

// Into the bundles by its bytes: no request for it can fail.
mkdirSync("build", { recursive: true });
const options = ["-O3", "--runtime", "stub", "--enable", "simd", "--noAssert"];
for (const name of ["restore", "bricks", "skip"]) {
  execFileSync("node_modules/.bin/asc", [`wasm/${name}.ts`, "--outFile", `build/${name}.wasm`, ...options], { stdio: "inherit" });
}

/** The licences of what a product contains, which they ask to be kept with it. */
function notices(...packages) {
  const texts = packages.map((name) => `${name}:\n\n${readFileSync(`node_modules/${name}/LICENSE`, "utf8").trim()}`);
  return { banner: { js: `/*!\nContains these packages.\n\n${texts.join("\n\n")}\n*/` } };
}

// The worker's address is relative to its script in every product. The package has its text as well, in a script that only
// those load who cannot have the worker.
const worker = (outfile) =>
  build({ ...common, ...notices("fzstd", "zstddec"), entryPoints: ["src/load/worker.ts"], outfile, minify: true });
const [withText, withoutText] = [true, false].map((has) => ({ define: { HAS_WORKER_TEXT: String(has) } }));

if (process.argv.includes("--package")) {
  rmSync("build/package", { recursive: true, force: true });
  // What two of them need is in a file of its own, so that a page has one class of each name.
  const entryPoints = { index: "src/index.ts", element: "src/element.ts", babylon: "src/babylon/index.ts" };
  await worker("build/package/worker.js");
  copyFileSync("build/package/worker.js", "build/worker.txt");
  const external = ["three", "three/*", "@babylonjs/*"];
  await build({ ...common, ...withText, entryPoints, outdir: "build/package", splitting: true, external });
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
  const others = readdirSync("tests/others").filter((name) => name !== "asked.ts");
  const outdir = "build/tests/others";
  await build({ ...common, ...withoutText, entryPoints: others.map((name) => `tests/others/${name}`), outdir });
  for (const release of ["oldest", "middle"]) {
    const entryPoints = [{ in: "tests/others/plugin.ts", out: `plugin.${release}` }];
    await build({ ...common, ...withoutText, entryPoints, outdir, alias: { three: `three-${release}` } });
  }
  await worker("build/tests/others/worker.js");
} else {
  const out = process.argv.includes("--check") ? "build/page" : "dist";
  await build({ ...common, ...withoutText, ...notices("three"), entryPoints: ["page/viewer.ts"], outfile: `${out}/viewer.js`, minify: true });
  await worker(`${out}/worker.js`);
  await build({ ...common, entryPoints: ["page/style.css"], outfile: `${out}/style.css`, minify: true });
  copyFileSync("page/index.html", `${out}/index.html`);
}
