/** The page: turning, dropping, keys, a lost device, small screens, assets. */

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { glb } from "./glb.js";
import { capture, CountingServer, launch, loseDevice, newPage, night, openOther, programPath, psnr, ready, ROOT, type View } from "./support.js";

declare global {
  interface Window {
    /** Of each draw of a field, whether it was to the canvas. */
    isOnCanvas: boolean[];
    /** Bits of red, alpha and depth, and samples, of the targets of these draws. */
    targets: Set<string>;
    /** Of all contexts. */
    textures: Set<WebGLTexture>;
  }
}

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
/** A white pixel. */
const WHITE = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4//8/AAX+Av4N70a4AAAAAElFTkSuQmCC";
const UPRIGHT = [-Math.SQRT1_2, 0, 0, Math.SQRT1_2];
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

/** A binary asset of a field in a container, and, far away, a textured triangle that needs light; `without` is a file that would hold the triangle. */
function asset(container: Buffer, rotation: number[], { fallback = true, neighbour = false, without = "" } = {}): Buffer {
  const triangle = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
  const json = {
    asset: { version: "2.0" },
    extensionsUsed: ["MIPVOG_radiance_field"],
    extensions: { MIPVOG_radiance_field: { radianceFields: [{ bufferView: 1, mimeType: "model/vnd.mipvog" }] } },
    scene: 0,
    scenes: [{ nodes: neighbour ? [0, 1] : [0] }],
    nodes: [
      { name: "field", rotation, scale: [2, 2, 2], ...(fallback ? { mesh: 0 } : {}), extensions: { MIPVOG_radiance_field: { radianceField: 0 } } },
      { name: "neighbour", translation: [50, 0, 0], mesh: 0 },
    ],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, material: 0 }] }],
    materials: [{ pbrMetallicRoughness: { metallicFactor: 0, baseColorTexture: { index: 0 } } }],
    textures: [{ source: 0 }],
    images: [{ uri: WHITE }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] }],
    bufferViews: [
      { buffer: without ? 1 : 0, byteOffset: 0, byteLength: 36 },
      { buffer: 0, byteOffset: 64, byteLength: container.length },
    ],
    buffers: [{ byteLength: 64 + container.length }, ...(without ? [{ uri: without, byteLength: 36 }] : [])],
  };
  return glb(json, Buffer.concat([triangle, Buffer.alloc(28), container]));
}

night("files are dropped one after the other: containers, assets, and what is neither", async () => {
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
  for (const rotation of [UPRIGHT, [0.5, -0.5, 0.5, 0.5]]) {
    await drop(page, "asset.glb", asset(bytes, rotation));
    await ready(page);
    const found = psnr(await capture(page, VIEW), picture);
    assert.ok(found > 50, `${found} dB`);
  }
  // A field that cannot be opened is told, though the asset can be.
  await drop(page, "asset.glb", asset(bytes.subarray(0, 1000), [0, 0, 0, 1]));
  await page.waitForFunction(() => window.__mipvog.error);
  const error = page.locator("#error");
  assert.match(await error.innerText(), /ends after 1000 bytes/);
  await error.locator("button").click();
  assert.ok(!(await error.isVisible()));
  assert.deepEqual(problems, []);
  await page.close();
});

test("an asset that lacks a part leaves no decoder at work", async () => {
  const { page } = await newPage(browser);
  await page.addInitScript(() => {
    const Own = Worker;
    const working = ((window as unknown as { working: Set<Worker> }).working = new Set());
    window.Worker = class extends Own {
      constructor(address: string | URL, options?: WorkerOptions) {
        super(address, options);
        working.add(this);
      }

      override terminate(): void {
        super.terminate();
        working.delete(this);
      }
    };
  });
  await page.goto(server.origin);
  await page.waitForFunction(() => window.__mipvog?.stage);
  const broken = asset(bytes, UPRIGHT, { neighbour: true, without: "missing.bin" });
  await drop(page, "asset.glb", broken);
  await page.waitForFunction(() => window.__mipvog.error);
  await page.waitForFunction(() => (window as unknown as { working: Set<Worker> }).working.size === 0);
  await page.close();
});

/** Counts textures of a page to come, whoever makes them. */
async function countTextures(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const context = WebGL2RenderingContext.prototype;
    const { createTexture, deleteTexture } = context;
    window.textures = new Set();
    context.createTexture = function () {
      const texture = createTexture.call(this);
      window.textures.add(texture);
      return texture;
    };
    context.deleteTexture = function (texture) {
      window.textures.delete(texture!);
      deleteTexture.call(this, texture);
    };
  });
}

/** What the device holds. */
function held(page: Page): Promise<object> {
  return page.evaluate(() => {
    const { memory, programs } = window.__mipvog.stage.renderer.info;
    return { geometries: memory.geometries, textures: window.textures.size, programs: programs?.length };
  });
}

night("meshes beside a field are lit, and nothing of a file stays on the device after it", async () => {
  const { page, problems } = await newPage(browser);
  await countTextures(page);
  await page.goto(server.origin);
  await page.waitForFunction(() => window.__mipvog?.stage);
  const after = [];
  for (const _ of [0, 1]) {
    await drop(page, "asset.glb", asset(bytes, UPRIGHT, { neighbour: true }));
    await ready(page);
    const pixel = (x: number) => page.evaluate((x) => Array.from(window.__mipvog.stage.capture(1, 1, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 0.2, 2, 1], 10)), x);
    // Straight at the triangle, from the side to which it faces, and past it.
    const triangle = await pixel(50.2);
    assert.notDeepEqual(triangle, await pixel(60));
    assert.ok(Math.min(...triangle) > 100, `${triangle}`);
    const during = await held(page);
    await drop(page, "tiny.mipvog", bytes);
    await ready(page);
    after.push(await held(page));
    assert.notDeepEqual(during, after.at(-1));
  }
  // What three.js keeps for itself is there after the first time.
  assert.deepEqual(after[1], after[0]);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a device without room is told in words, and what it had taken is free again", async () => {
  const { page, problems } = await newPage(browser);
  await countTextures(page);
  await page.goto(server.origin);
  await page.waitForFunction(() => window.__mipvog?.stage);
  await page.evaluate(() => {
    const context = WebGL2RenderingContext.prototype;
    const { texStorage3D, getError } = context;
    let refused = false;
    context.texStorage3D = function (...sizes) {
      refused = true;
      texStorage3D.apply(this, sizes);
    };
    context.getError = function () {
      const error = refused ? this.OUT_OF_MEMORY : getError.call(this);
      refused = false;
      return error;
    };
  });
  const before = await held(page);
  await drop(page, "tiny.mipvog", bytes);
  await page.waitForFunction(() => window.__mipvog.error);
  assert.match(await page.locator("#error").innerText(), /no room for \d+ MB/);
  await page.waitForFunction(() => window.__mipvog.stage.settled);
  const { textures } = (await held(page)) as { textures: number };
  assert.equal(textures, (before as { textures: number }).textures);
  assert.deepEqual(problems, []);
  await page.close();
});

test("the plugin in somebody's page leaves what it cannot open, and says so", async () => {
  const { page, problems } = await newPage(browser);
  await openOther(page, server, "plugin");
  const list = (content: Buffer) => page.evaluate((address) => window.list(address), server.offer("asset.glb", content));
  const neighbour = { name: "neighbour", kind: "Mesh", error: null };
  const field = await list(asset(bytes, UPRIGHT, { neighbour: true }));
  assert.deepEqual(field, [{ name: "field", kind: "RadianceField", error: null }, neighbour]);
  for (const fallback of [true, false]) {
    const [broken, ...others] = await list(asset(bytes.subarray(0, 1000), UPRIGHT, { fallback, neighbour: true }));
    assert.deepEqual([broken.name, broken.kind], ["field", fallback ? "Mesh" : "Object3D"]);
    assert.match(broken.error!, /ends after 1000 bytes/);
    assert.deepEqual(others, [neighbour]);
  }
  const given = await page.evaluate((address) => window.giveUp(address), server.offer("tiny.mipvog", bytes));
  for (const message of given) assert.match(message, /given up/);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a field is drawn where nobody sees it before it is drawn on the canvas, in the same kind of target", async () => {
  const { page } = await newPage(browser);
  await page.addInitScript(() => {
    const { prototype } = WebGL2RenderingContext;
    const { drawElements } = prototype;
    window.isOnCanvas = [];
    // Of all that the page draws, fields alone have indices.
    prototype.drawElements = function (...parameters) {
      window.isOnCanvas.push(this.getParameter(this.FRAMEBUFFER_BINDING) === null);
      const bits = [this.RED_BITS, this.ALPHA_BITS, this.DEPTH_BITS, this.SAMPLES].map((name) => this.getParameter(name) as number);
      window.targets.add(bits.join());
      drawElements.apply(this, parameters);
    };
    window.targets = new Set();
  });
  await page.goto(server.page("tiny.mipvog", bytes));
  await ready(page);
  const { isOnCanvas, targets } = await page.evaluate(() => ({ isOnCanvas: window.isOnCanvas, targets: [...window.targets] }));
  assert.deepEqual([isOnCanvas[0], new Set(isOnCanvas.slice(1))], [false, new Set([true])]);
  assert.equal(targets.length, 1, `red, alpha, depth and samples of targets: ${targets}`);
  await page.close();
});

night("counting samples leaves the renderer as it was", async () => {
  const { page } = await newPage(browser);
  await page.goto(server.page("tiny.mipvog", bytes));
  await ready(page);
  const alpha = await page.evaluate(() => {
    const { renderer } = window.__mipvog.stage;
    renderer.setClearAlpha(0.75);
    window.__mipvog.statistics(true);
    return renderer.getClearAlpha();
  });
  assert.equal(alpha, 0.75);
  await page.close();
});

night("a lost device is told, and the picture comes back with it", async () => {
  const { page, problems } = await newPage(browser);
  await page.goto(server.page("tiny.mipvog", bytes));
  await ready(page);
  const before = await capture(page, VIEW);
  const restore = await loseDevice(page);
  assert.match(await page.locator("#error").innerText(), /device was taken away/);
  await restore();
  await ready(page);
  assert.ok(!(await page.locator("#error").isVisible()));
  assert.equal(psnr(await capture(page, VIEW), before), Infinity);
  // three.js itself tells of the loss.
  assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
  await page.close();
});

for (const scheme of ["light", "dark"] as const) {
  night(`the page fits 320 pixels and is readable when it is ${scheme}`, async () => {
    const { page, problems } = await newPage(browser, { width: 320, height: 480 });
    await page.emulateMedia({ colorScheme: scheme });
    await page.goto(server.page("tiny.mipvog", bytes));
    await ready(page);
    await page.locator("#panel > summary").click();
    await page.locator("#numbers > summary").click();
    await page.locator("#facts", { hasText: "Samples a ray" }).waitFor();
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(wide <= 320, `${wide} pixels`);
    // A rule that the browser does not understand is not there at all.
    const rules = await page.evaluate(() => Array.from(document.styleSheets[0].cssRules, (rule) => (rule as CSSStyleRule).selectorText));
    assert.ok(rules.includes("#progress::-webkit-progress-value"), `${rules}`);
    const light = await page.evaluate(() => getComputedStyle(document.body).color);
    const bright = light.match(/\d+/g)!.slice(0, 3).every((value) => Number(value) > 128);
    assert.equal(bright, scheme === "dark");
    assert.deepEqual(problems, []);
    await page.close();
  });
}
