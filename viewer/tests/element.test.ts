/** `<mipvog-viewer>` in a page: it keeps the view that a hand chose, and nothing of it goes on outside of the page. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, JSHandle, Page } from "playwright-core";
import type { MipvogViewer } from "../src/element.js";
import { CountingServer, launch, newPage, ROOT } from "./support.js";

const server = new CountingServer();
let browser: Browser;

before(async () => {
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

/** An element of a page of its own, with its scene loaded. */
async function open(): Promise<{ page: Page; element: JSHandle<MipvogViewer>; problems: string[] }> {
  const address = server.offer("tiny.mipvog", readFileSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog")));
  const { page, problems } = await newPage(browser);
  await page.goto(server.offer("blank.html", Buffer.from('<!doctype html><link rel="icon" href="data:,">')));
  await page.addScriptTag({ path: join("build", "tests", "others", "element.js"), type: "module" });
  await page.waitForFunction(() => customElements.get("mipvog-viewer"));
  const element = await page.evaluateHandle((address) => {
    const element = document.createElement("mipvog-viewer") as MipvogViewer;
    element.setAttribute("src", address);
    document.body.append(element);
    return element;
  }, address);
  await whole(page, element);
  return { page, element, problems };
}

/** Waits until the finest level is shown. */
async function whole(page: Page, element: JSHandle<MipvogViewer>): Promise<void> {
  await page.waitForFunction((element) => element.fields[0]?.finest === 0 && element.stage?.settled, element);
}

/** Where the element's camera is. */
function camera(element: JSHandle<MipvogViewer>): Promise<number[]> {
  return element.evaluate((element) => element.stage!.camera.position.toArray());
}

test("a view that a hand chose stays while levels come again", async () => {
  const { page, element, problems } = await open();
  const framed = await camera(element);
  await element.evaluate((element) => element.stage!.orbit(0.5, 0));
  const chosen = await camera(element);
  assert.notDeepEqual(chosen, framed);
  await element.evaluate(async ({ stage, fields }) => {
    const { canvas } = stage!.renderer.getContext();
    const [lost, back] = ["webglcontextlost", "webglcontextrestored"].map((name) => new Promise((done) => canvas.addEventListener(name, done)));
    const device = stage!.renderer.getContext().getExtension("WEBGL_lose_context")!;
    device.loseContext();
    await lost;
    // A context can be given back once all who listen have heard of its loss.
    await new Promise((done) => setTimeout(done));
    const again = new Promise((done) => fields[0].addEventListener("change", done));
    device.restoreContext();
    await back;
    await again;
  });
  await whole(page, element);
  const after = await camera(element);
  after.forEach((value, axis) => assert.ok(Math.abs(value - chosen[axis]) < 1e-6, `${after} after ${chosen}`));
  // three.js itself tells of the loss.
  assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
  await page.close();
});

test("an element outside of the page hears no keys and draws nothing, and shows its scene when it is back", async () => {
  const { page, element, problems } = await open();
  const moved = await element.evaluate(async (element) => {
    const stage = element.stage!;
    const canvas = stage.renderer.domElement;
    const press = () => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
    const place = () => stage.camera.position.toArray().join();
    const start = place();
    press();
    const turned = place();
    // A picture is on its way while it is left.
    stage.painter.draw(false);
    element.remove();
    let pictures = 0;
    stage.painter.drawn = () => pictures++;
    press();
    await new Promise((done) => setTimeout(done, 500));
    return { turns: turned !== start, turnsOutside: place() !== turned, pictures };
  });
  assert.deepEqual(moved, { turns: true, turnsOutside: false, pictures: 0 });
  await element.evaluate((element) => document.body.append(element));
  await whole(page, element);
  assert.deepEqual(problems, []);
  await page.close();
});

test("properties are the attributes, whenever they are set", async () => {
  const { page, element, problems } = await open();
  const told = await element.evaluate(async (element) => {
    const names = ["src", "background", "alt"] as const;
    const before = names.map((name) => element[name]);
    const [address] = before;
    [element.background, element.alt] = ["rgb(255, 0, 0)", "A digger"];
    const attributes = names.map((name) => element.getAttribute(name));
    const label = element.shadowRoot!.querySelector("canvas")!.ariaLabel;
    [element.background, element.alt] = [null, null];
    const without = names.map((name) => element.hasAttribute(name));
    // As frameworks do it: what was set before the element was in a page, and before it was known.
    const other = document.createElement("mipvog-viewer");
    other.src = address;
    const early = document.createElement("mipvog-viewer");
    Object.defineProperty(early, "src", { value: address, configurable: true, writable: true, enumerable: true });
    const loaded = [other, early].map((one) => new Promise((done) => one.addEventListener("load", done)));
    document.body.append(other, early);
    await Promise.all(loaded);
    const early2 = early.getAttribute("src");
    other.src = null;
    const gone = other.fields.length;
    other.remove();
    early.remove();
    return { before, attributes, label, without, early2, gone, address };
  });
  assert.deepEqual(told.before.slice(1), ["", ""]);
  assert.match(told.address, /tiny\.mipvog$/);
  assert.deepEqual(told.attributes, [told.address, "rgb(255, 0, 0)", "A digger"]);
  assert.equal(told.label, "A digger");
  assert.deepEqual(told.without, [true, false, false]);
  assert.deepEqual([told.early2, told.gone], [told.address, 0]);
  assert.deepEqual(problems, []);
  await page.close();
});

test("any color of the browser lies behind the field, also one that is seen through", async () => {
  const { page, element, problems } = await open();
  const corner = async () => {
    await page.waitForFunction((element) => element.stage?.settled, element);
    const data = (await page.screenshot()).toString("base64");
    return page.evaluate(async (data) => {
      const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
      const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
      const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
      context.drawImage(picture, 0, 0);
      return Array.from(context.getImageData(12, 12, 1, 1).data.subarray(0, 3));
    }, data);
  };
  assert.deepEqual(await corner(), [255, 255, 255]);
  await page.evaluate(() => (document.body.style.cssText = "background: #00ff00; --ground: #102030"));
  for (const [color, wanted] of [["transparent", [0, 255, 0]], ["var(--ground)", [16, 32, 48]], ["oklch(0 0 0)", [0, 0, 0]], ["no color", [255, 255, 255]], ["#0000ff", [0, 0, 255]]] as const) {
    await element.evaluate((element, color) => (element.background = color), color);
    assert.deepEqual(await corner(), wanted, color);
  }
  assert.deepEqual(problems, []);
  await page.close();
});

test("what fails is told once, with what to do, and leaves nothing", async () => {
  const { page, element } = await open();
  const contents: [string, Buffer, RegExp][] = [
    ["a.ply", Buffer.from("ply\nformat ascii 1.0"), /a PLY file.*Open a \.mipvog container/],
    ["a.npz", Buffer.from("PK\x03\x04 and more than that, so that it is no container"), /a ZIP archive.*Bake it first/],
    ["a.png", Buffer.from([0x89, 0x50, 0x4e, 0x47, 13, 10, 26, 10, 0]), /a PNG picture/],
    ["page", Buffer.from("  <!doctype html><p>not here"), /is a page.*server answers with a page/],
    ["a.mipvog", Buffer.from("glTF and more than that, so that it is no container"), /a binary glTF asset.*ending \.glb/],
    ["a.glb", Buffer.from("glTF\x02\0\0\0 no asset at all"), /no glTF asset that can be read/],
  ];
  for (const [name, content, message] of contents) {
    const address = server.offer(name, content);
    const told = await element.evaluate(async (element, address) => {
      const errors: string[] = [];
      const hear = (event: Event) => errors.push(`${(event as CustomEvent).detail.message} ${(event as CustomEvent).detail.remedy}`);
      element.addEventListener("error", hear);
      element.src = address;
      await new Promise((done) => element.addEventListener("error", done, { once: true }));
      await new Promise((done) => setTimeout(done, 100));
      element.removeEventListener("error", hear);
      return { errors, fields: element.fields.length, shown: element.shadowRoot!.querySelector("p")!.textContent };
    }, address);
    assert.equal(told.errors.length, 1, name);
    assert.match(told.errors[0], message);
    assert.doesNotMatch(told.errors[0], /\.\./);
    assert.equal(told.shown, told.errors[0]);
    assert.equal(told.fields, 0);
  }
  await page.close();
});

test("a browser without WebGL 2 is told once, and what to do", async () => {
  const { page } = await newPage(browser);
  await page.addInitScript(() => {
    const { getContext } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function (this: HTMLCanvasElement, kind: string, ...more: unknown[]) {
      return kind.startsWith("webgl") ? null : getContext.call(this, kind as "2d", ...(more as []));
    } as typeof getContext;
  });
  const address = server.offer("tiny.mipvog", readFileSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog")));
  await page.goto(server.offer("blank.html", Buffer.from('<!doctype html><link rel="icon" href="data:,">')));
  await page.addScriptTag({ path: join("build", "tests", "others", "element.js"), type: "module" });
  await page.waitForFunction(() => customElements.get("mipvog-viewer"));
  await page.evaluate((address) => {
    const element = document.createElement("mipvog-viewer");
    element.src = address;
    document.body.append(element);
  }, address);
  const message = page.locator("mipvog-viewer p");
  await message.waitFor();
  assert.match(await message.innerText(), /WebGL 2?.* Use a current browser, or switch hardware acceleration on\.$/);
  assert.doesNotMatch(await message.innerText(), /\.\./);
  await page.goto(`${server.origin}/`);
  const card = page.locator("#error");
  await card.waitFor();
  assert.match(await card.innerText(), /Use a current browser/);
  assert.doesNotMatch(await card.innerText(), /\.\./);
  await page.close();
});
