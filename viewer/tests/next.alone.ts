/** The example of Next.js: the server draws the element's tag, and the browser takes it over. It fetches Next.js. */

import assert from "node:assert/strict";
import { type ChildProcess, spawn } from "node:child_process";
import { cpSync, mkdirSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { before, test } from "node:test";
import { npm, packed, showsAt } from "./installed.js";
import { launch, newPage, ROOT } from "./support.js";

const NEXT = "16.4.6";
const SITE = join(process.cwd(), "build", "next");
const LAYOUT = "export default function Layout({ children }) { return <html lang=\"en\"><body>{children}</body></html>; }\n";

before(() => {
  rmSync(SITE, { recursive: true, force: true });
  for (const folder of ["app", "public"]) mkdirSync(join(SITE, folder), { recursive: true });
  writeFileSync(join(SITE, "package.json"), '{ "private": true }');
  npm(SITE, "install", "--no-audit", "--no-fund", `./${packed(SITE)}`, `next@${NEXT}`, "react@19.3.1", "react-dom@19.3.1", "three@0.187.0");
  cpSync(join("examples", "next", "page.jsx"), join(SITE, "app", "page.jsx"));
  cpSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog"), join(SITE, "public", "scene.mipvog"));
  writeFileSync(join(SITE, "app", "layout.jsx"), LAYOUT);
  // Browsers ask for one.
  writeFileSync(join(SITE, "app", "icon.svg"), '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>');
  npm(SITE, "exec", "next", "build");
});

/** Starts the built site; resolves to its address. */
function started(): Promise<{ site: ChildProcess; address: string }> {
  const site = spawn("node", [join("node_modules", "next", "dist", "bin", "next"), "start", "--port", "0", "--hostname", "127.0.0.1"], { cwd: SITE, stdio: ["ignore", "pipe", "inherit"] });
  let told = "";
  return new Promise((found, failed) => {
    site.once("exit", () => failed(new Error(`Next.js ended: ${told}`)));
    site.stdout!.on("data", (text) => {
      told += text;
      const address = /http:\/\/127\.0\.0\.1:\d+/.exec(told);
      if (address) found({ site, address: address[0] });
    });
  });
}

test("a site of Next.js draws the tag on its server and shows the scene", async (context) => {
  const { site, address } = await started();
  const browser = await launch();
  context.after(async () => {
    await browser.close();
    site.kill();
  });
  const drawn = await (await fetch(address)).text();
  assert.match(drawn, /<mipvog-viewer src="scene\.mipvog" alt="A toy digger"><\/mipvog-viewer>/);
  const { page, problems } = await newPage(browser, { width: 300, height: 200 });
  const elsewhere: string[] = [];
  page.on("request", (request) => {
    const { origin, protocol } = new URL(request.url());
    if (protocol.startsWith("http") && origin !== address) elsewhere.push(request.url());
  });
  await showsAt(page, problems, `${address}/`, "error");
  assert.deepEqual(elsewhere, []);
});
