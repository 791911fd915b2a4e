/** The page: turning, dropping, keys, a lost device, small screens, assets. */

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { capture, CountingServer, launch, newPage, programPath, psnr, ready, ROOT, type View } from "./support.js";

const TINY = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
const VIEW: View = {
  width: 96,
  height: 96,
  focal: 130,
  toWorld: [
    [0, -0.5, 0.866, 3.5],
    [1, 0, 0, 0],
    [0, 0.866, 0.5, 2.2],
    [0, 0, 0, 1],
  ],
};
let server: CountingServer;
let browser: Browser;
let bytes: Buffer;

before(async () => {
  bytes = readFileSync(TINY);
  server = new CountingServer();
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

/** Where the camera is, rounded. */
function camera(page: Page): Promise<number[]> {
  return page.evaluate(() => window.__mipvog.stage.camera.position.toArray().map((value) => Math.round(value * 1e4) / 1e4));
}

test("the program serves the page and the file, and dragging turns the field", async () => {
  const view = spawn(programPath(), ["view", "--no-open", TINY], { stdio: ["ignore", "pipe", "ignore"] });
  try {
    const url = await new Promise<string>((found) => createInterface(view.stdout).once("line", found));
    const { page, problems } = await newPage(browser);
    await page.goto(url);
    await ready(page);
    assert.equal(await page.evaluate(() => window.__mipvog.field!.file!.transfer), "ranges");
    const [before, picture] = [await camera(page), await page.screenshot()];
    await page.mouse.move(200, 120);
    await page.mouse.down();
    await page.mouse.move(260, 140, { steps: 3 });
    await page.mouse.up();
    await page.waitForFunction(() => window.__mipvog.ready);
    assert.notDeepEqual(await camera(page), before);
    assert.ok(!picture.equals(await page.screenshot()), "the picture turns");
    assert.deepEqual(problems, []);
    await page.close();
  } finally {
    view.kill();
  }
});

test("keys turn, move, zoom, start over and colour levels", async () => {
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("tiny.mipvog", bytes));
  await ready(page);
  const start = await camera(page);
  await page.focus("#picture");
  const distance = (place: number[], other: number[]) => Math.hypot(...place.map((value, axis) => value - other[axis]));
  for (const key of ["ArrowLeft", "ArrowUp", "Shift+ArrowRight", "+", "-"]) {
    const before = await camera(page);
    await page.keyboard.press(key);
    assert.ok(distance(await camera(page), before) > 0.01, key);
  }
  await page.keyboard.press("r");
  assert.ok(distance(await camera(page), start) < 1e-3);
  const plain = await capture(page, VIEW);
  await page.keyboard.press("l");
  assert.ok(psnr(await capture(page, VIEW), plain) < 30);
  await page.keyboard.press("l");
  assert.equal(psnr(await capture(page, VIEW), plain), Infinity);
  assert.deepEqual(problems, []);
  await page.close();
});

/** Drops a file on the page. */
async function drop(page: Page, name: string, content: Buffer): Promise<void> {
  const transfer = await page.evaluateHandle(
    ([name, data]) => {
      const transfer = new DataTransfer();
      transfer.items.add(new File([Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0))], name));
      return transfer;
    },
    [name, content.toString("base64")],
  );
  await page.dispatchEvent("#picture", "dragover", { dataTransfer: transfer });
  await page.dispatchEvent("#picture", "drop", { dataTransfer: transfer });
}

/** A binary asset with the container inside, on a node with a mesh of its own. */
function asset(container: Buffer, rotation: number[]): Buffer {
  const triangle = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
  const json = {
    asset: { version: "2.0" },
    extensionsUsed: ["MIPVOG_radiance_field"],
    extensions: { MIPVOG_radiance_field: { radianceFields: [{ bufferView: 1, mimeType: "model/vnd.mipvog" }] } },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ rotation, scale: [2, 2, 2], mesh: 0, extensions: { MIPVOG_radiance_field: { radianceField: 0 } } }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 } }] }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] }],
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: 36 },
      { buffer: 0, byteOffset: 64, byteLength: container.length },
    ],
    buffers: [{ byteLength: 64 + container.length }],
  };
  const chunk = (kind: string, content: Buffer, fill: number) => {
    const padded = Buffer.concat([content, Buffer.alloc((4 - (content.length % 4)) % 4, fill)]);
    const head = Buffer.alloc(8);
    head.writeUInt32LE(padded.length);
    head.write(kind, 4, "latin1");
    return Buffer.concat([head, padded]);
  };
  const binary = Buffer.concat([triangle, Buffer.alloc(28), container]);
  const chunks = Buffer.concat([chunk("JSON", Buffer.from(JSON.stringify(json)), 0x20), chunk("BIN\0", binary, 0)]);
  const head = Buffer.alloc(12);
  head.write("glTF");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + chunks.length, 8);
  return Buffer.concat([head, chunks]);
}

test("files are dropped one after the other: containers, assets, and what is neither", async () => {
  const { page, problems } = await newPage(browser);
  await page.goto(server.origin);
  await page.waitForFunction(() => window.__mipvog);
  assert.ok(await page.locator("#hint").isVisible());
  await drop(page, "some.bin", bytes);
  await ready(page);
  assert.ok(!(await page.locator("#hint").isVisible()));
  const picture = await capture(page, VIEW);
  assert.ok(new Set(picture).size > 50, "something is to be seen");
  await drop(page, "words.mipvog", Buffer.from("no container, but long enough to be looked at as an asset"));
  await page.waitForFunction(() => window.__mipvog.error);
  assert.match(await page.locator("#error").innerText(), /no \.mipvog container/);
  // A node may turn and scale the field: seen from the same side it looks the same, for the network too.
  for (const rotation of [
    [-Math.SQRT1_2, 0, 0, Math.SQRT1_2],
    [0.5, -0.5, 0.5, 0.5],
  ]) {
    await drop(page, "asset.glb", asset(bytes, rotation));
    await ready(page);
    const found = psnr(await capture(page, VIEW), picture);
    assert.ok(found > 50, `${found} dB`);
  }
  // A field that cannot be opened is told, though the asset can be.
  await drop(page, "asset.glb", asset(bytes.subarray(0, 1000), [0, 0, 0, 1]));
  await page.waitForFunction(() => window.__mipvog.error);
  assert.match(await page.locator("#error").innerText(), /ends after 1000 bytes/);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a lost device is told, and the picture comes back with it", async () => {
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("tiny.mipvog", bytes));
  await ready(page);
  const before = await capture(page, VIEW);
  const lost = await page.evaluateHandle(() => {
    const canvas = document.querySelector("canvas")!;
    const lost = window.__mipvog.stage.renderer.getContext().getExtension("WEBGL_lose_context")!;
    const gone = new Promise((resolve) => canvas.addEventListener("webglcontextlost", resolve));
    lost.loseContext();
    return gone.then(() => lost);
  });
  assert.match(await page.locator("#error").innerText(), /device was taken away/);
  await page.evaluate((lost) => {
    const back = new Promise<void>((resolve) => document.querySelector("canvas")!.addEventListener("webglcontextrestored", () => resolve()));
    lost.restoreContext();
    return back;
  }, lost);
  await ready(page);
  assert.ok(!(await page.locator("#error").isVisible()));
  assert.equal(psnr(await capture(page, VIEW), before), Infinity);
  // three.js itself tells of the loss.
  assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
  await page.close();
});

for (const scheme of ["light", "dark"] as const) {
  test(`the page fits 320 pixels and is readable when it is ${scheme}`, async () => {
    const { page, problems } = await newPage(browser, { width: 320, height: 480 });
    await page.emulateMedia({ colorScheme: scheme });
    await page.goto(server.page("tiny.mipvog", bytes));
    await ready(page);
    await page.locator("#panel summary").click();
    await page.locator("#facts", { hasText: "Samples a ray" }).waitFor();
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(wide <= 320, `${wide} pixels`);
    const light = await page.evaluate(() => getComputedStyle(document.body).color);
    const bright = light.match(/\d+/g)!.slice(0, 3).every((value) => Number(value) > 128);
    assert.equal(bright, scheme === "dark");
    assert.deepEqual(problems, []);
    await page.close();
  });
}
