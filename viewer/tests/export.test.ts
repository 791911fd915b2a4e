/** Pages that `export --to html` writes. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import type { Browser, Page } from "playwright-core";
import { capture, CountingServer, launch, newPage, night, pixels, program, psnr, ready, ROOT, temporaryFolder, views } from "./support.js";

const LEGO = join(ROOT, "fixtures", "trained", "lego64");
const CAMERAS = join(LEGO, "transforms_test.json");
const folder = temporaryFolder();
const at = (name: string) => join(folder.path, name);
let browser: Browser;

before(async () => {
  program("bake", join(LEGO, "fine_last.tar"), "--stepsize", "0.5", "--preset", "web", "-o", at("lego64.mipvog"));
  program("render", at("lego64.mipvog"), "--cameras", CAMERAS, "--size", "200x200", "--frames", "0", "-o", at("reference"));
  program("export", at("lego64.mipvog"), "--to", "html", "-o", at("page.html"));
  program("export", at("lego64.mipvog"), "--to", "html", "-o", at("site"));
  browser = await launch();
});

after(async () => {
  await browser.close();
  folder.remove();
});

async function looksRight(page: Page): Promise<void> {
  await ready(page);
  const found = psnr(await capture(page, views(CAMERAS, 200)[0]), await pixels(page, join(at("reference"), "r_0.s1.png")));
  assert.ok(found >= 40, `${found} dB`);
}

test("a page opens from a disk, under its own policy, and asks nobody for anything", async () => {
  const { page, problems } = await newPage(browser);
  const asked: string[] = [];
  page.on("request", (request) => asked.push(request.url()));
  const address = pathToFileURL(at("page.html")).href;
  await page.goto(address);
  await looksRight(page);
  assert.deepEqual(asked.filter((url) => url !== address && !/^(blob|data):/.test(url)), []);
  // The policy lets no request out.
  const refused = await page.evaluate(() => fetch("http://127.0.0.1:9/").then(() => "answered", () => "refused"));
  assert.equal(refused, "refused");
  assert.ok(problems.splice(0).some((problem) => problem.includes("Content Security Policy")));
  await page.close();
});

night("a frame of a notebook, whose document is text, shows the field", async () => {
  const { page, problems } = await newPage(browser);
  await page.setContent('<iframe sandbox="allow-scripts" allow="fullscreen; xr-spatial-tracking" style="width: 400px; height: 300px"></iframe>');
  await page.evaluate((text) => document.querySelector("iframe")!.setAttribute("srcdoc", text), readFileSync(at("page.html"), "utf8"));
  const frame = (await (await page.$("iframe"))!.contentFrame())!;
  await ready(frame);
  const found = psnr(await capture(frame, views(CAMERAS, 200)[0]), await pixels(page, join(at("reference"), "r_0.s1.png")));
  assert.ok(found >= 40, `${found} dB`);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a folder opens from a plain server, in ranges where it has them", async () => {
  const bytes = readFileSync(join(at("site"), "lego64.mipvog"));
  for (const ranges of [true, false]) {
    const server = new CountingServer(at("site"));
    await server.start();
    server.offer("lego64.mipvog", bytes);
    server.ranges = ranges;
    // The policy that the folder's notes name.
    server.headers = {
      "Content-Security-Policy": "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self' data: blob:",
    };
    const { page, problems } = await newPage(browser);
    // Nothing more arrives before the first picture is there.
    if (ranges) server.gate = 0.04 * bytes.length;
    await page.goto(`${server.origin}/`);
    await page.waitForFunction(() => window.__mipvog?.firstPicture);
    server.open(Infinity);
    await looksRight(page);
    assert.equal(server.sent, bytes.length);
    assert.equal(await page.title().then((title) => title.includes("lego64")), true);
    assert.deepEqual(problems, []);
    await page.close();
    server.stop();
  }
});
