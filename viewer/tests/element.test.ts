/** `<mipvog-viewer>` in a page: it keeps the view that a hand chose, and nothing of it goes on outside of the page. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, JSHandle, Page } from "playwright-core";
import type { MipvogViewer } from "../src/element.js";
import { CountingServer, launch, newPage, ROOT, night } from "./support.js";

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

night("a view that a hand chose stays while levels come again", async () => {
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

night("an element outside of the page hears no keys and draws nothing, and shows its scene when it is back", async () => {
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

night("properties are the attributes, whenever they are set", async () => {
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

night("any color of the browser lies behind the field, also one that is seen through", async () => {
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
      const hear = (event: Event) => errors.push(`${(event as unknown as CustomEvent).detail.message} ${(event as CustomEvent).detail.remedy}`);
      element.addEventListener("error", hear);
      element.src = address;
      await new Promise((done) => element.addEventListener("error", done, { once: true }));
      await new Promise((done) => setTimeout(done, 100));
      element.removeEventListener("error", hear);
      return { errors, fields: element.fields.length, shown: element.shadowRoot!.querySelector("p span")!.textContent };
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
  const message = page.locator("mipvog-viewer p span");
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

/** A page with elements, made of their attributes, some of them far down. */
async function openMany(attributes: Record<string, string>[], style = ""): Promise<{ page: Page; problems: string[] }> {
  const address = server.offer("tiny.mipvog", readFileSync(join(ROOT, "fixtures", "baked", "tiny.rate.mipvog")));
  const { page, problems } = await newPage(browser);
  await page.goto(server.offer("blank.html", Buffer.from('<!doctype html><link rel="icon" href="data:,">')));
  await page.addScriptTag({ path: join("build", "tests", "others", "element.js"), type: "module" });
  await page.waitForFunction(() => customElements.get("mipvog-viewer"));
  await page.evaluate(([address, all, style]) => {
    document.body.innerHTML = all.map((attributes) => `<mipvog-viewer src="${address}" style="${style}" ${Object.entries(attributes).map(([name, value]) => `${name}="${value}"`).join(" ")}></mipvog-viewer>`).join("");
  }, [address, attributes, style] as const);
  return { page, problems };
}

const shown = (page: Page, index = 0) => page.waitForFunction((index) => {
  const element = document.querySelectorAll("mipvog-viewer")[index];
  return element.fields[0]?.finest === 0 && element.stage?.settled;
}, index);

night("the camera starts where it is told, keeps to its limits, and turns by itself", async () => {
  const { page, problems } = await openMany([{ camera: "3,1,0,0,0,0,50", "distance-limits": "2 3.5", "elevation-limits": "0 45", "disable-pan": "" }]);
  await shown(page);
  const told = await page.evaluate(async () => {
    const [element] = document.querySelectorAll("mipvog-viewer");
    const stage = element.stage!;
    const frames = (count: number) => new Promise<void>((done) => requestAnimationFrame(() => (count > 1 ? void frames(count - 1).then(done) : done())));
    const { position, fov } = stage.viewpoint;
    const start = [...position.toArray(), fov];
    const distance = () => stage.camera.position.distanceTo(stage.controls.target);
    const to = async (x: number, y: number) => {
      stage.camera.position.set(x, y, 0);
      await frames(3);
      return [distance(), (Math.asin(stage.camera.position.y / distance()) * 180) / Math.PI];
    };
    const limits = [await to(20, 1), await to(0.5, 0.1), await to(3, -2), await to(0.1, 3)];
    stage.reset();
    const back = stage.camera.position.toArray();
    const isStill = stage.camera.position.x;
    element.setAttribute("auto-rotate", "");
    await frames(10);
    const turned = stage.camera.position.x !== isStill;
    return { start, limits, back, turned, pan: stage.controls.enablePan };
  });
  told.start.forEach((value, i) => assert.ok(Math.abs(value! - [3, 1, 0, 50][i]) < 1e-6));
  const near = (value: number, wanted: number) => assert.ok(Math.abs(value - wanted) < 0.01, `${value} for ${wanted}`);
  near(told.limits[0][0], 3.5);
  near(told.limits[1][0], 2);
  near(told.limits[2][1], 0);
  near(told.limits[3][1], 45);
  told.back.forEach((value, i) => near(value, [3, 1, 0][i]));
  assert.deepEqual([told.turned, told.pan], [true, false]);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a page scrolls over an element, whose wheel zooms where a hand or a key says so", async () => {
  const { page, problems } = await openMany([{ tabindex: "-1" }, { "touch-action": "none", "disable-zoom": "" }], "margin-bottom: 1000px");
  await shown(page);
  const state = () => page.evaluate(() => [scrollY, document.querySelector("mipvog-viewer")!.stage!.camera.position.length()]);
  const [, distance] = await state();
  await page.mouse.move(150, 100);
  await page.mouse.wheel(0, 60);
  await page.waitForFunction(() => scrollY > 0);
  assert.ok(Math.abs((await state())[1] - distance) < 1e-9);
  await page.evaluate(() => scrollTo(0, 0));
  await page.mouse.click(150, 100);
  await page.mouse.wheel(0, -60);
  await page.waitForFunction((distance) => document.querySelector("mipvog-viewer")!.stage!.camera.position.length() < distance - 1e-3, distance);
  assert.equal((await state())[0], 0);
  const actions = await page.evaluate(() => Array.from(document.querySelectorAll("mipvog-viewer"), (one) => getComputedStyle(one.shadowRoot!.querySelector("canvas")!).touchAction));
  assert.equal(actions[0], "pan-y");
  await page.evaluate(() => document.querySelectorAll("mipvog-viewer")[1].scrollIntoView());
  await shown(page, 1);
  const [action, zooms] = await page.evaluate(() => {
    const [, second] = document.querySelectorAll("mipvog-viewer");
    return [second.shadowRoot!.querySelector("canvas")!.style.touchAction, second.stage!.controls.enableZoom];
  });
  assert.deepEqual([action, zooms], ["none", false]);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a lazy element waits until it is near, with its poster", async () => {
  const poster = "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='3' height='2'><rect width='3' height='2' fill='red'/></svg>";
  const { page, problems } = await openMany([{}, { loading: "lazy", poster }], "margin-bottom: 1500px");
  await shown(page);
  const hidden = () => page.evaluate(() => document.querySelectorAll("mipvog-viewer")[1].shadowRoot!.querySelector("img")!.hidden);
  assert.deepEqual([await hidden(), await page.evaluate(() => document.querySelectorAll("mipvog-viewer")[1].stage)], [false, null]);
  await page.evaluate(() => document.querySelectorAll("mipvog-viewer")[1].scrollIntoView());
  await shown(page, 1);
  assert.equal(await hidden(), true);
  assert.deepEqual(problems, []);
  await page.close();
});

night("of more elements than the browser has contexts, each shows its picture, and those in use are live", async () => {
  const { page, problems } = await openMany(Array.from({ length: 18 }, () => ({})), "display: inline-block; width: 60px");
  await page.waitForFunction(() => [...document.querySelectorAll("mipvog-viewer")].every((one) => {
    const canvas = one.shadowRoot!.querySelector("canvas")!;
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d")!;
    copy.drawImage(canvas, 0, 0);
    return new Set(new Uint32Array(copy.getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size > 50;
  }), null, { polling: 500 });
  const still = await page.evaluate(() => Array.from(document.querySelectorAll("mipvog-viewer")).findIndex((one) => !one.stage));
  await page.locator("mipvog-viewer").nth(still).click();
  await shown(page, still);
  assert.equal(await page.evaluate(() => Array.from(document.querySelectorAll("mipvog-viewer")).filter((one) => one.stage).length), 8);
  assert.deepEqual(problems.filter((problem) => !/context lost|ReadPixels/i.test(problem)), []);
  await page.close();
});

night("children lie over the places that they name", async () => {
  const { page, problems } = await openMany([{ camera: "3,0,0,0,0,0" }]);
  await page.evaluate(() => (document.querySelector("mipvog-viewer")!.innerHTML = '<b data-position="0 0 0">middle</b><b data-position="0, 0.5, 0">above</b><b data-position="9 0 0">behind</b>'));
  await shown(page);
  await page.waitForFunction(() => document.querySelector<HTMLElement>("b")!.style.transform !== "");
  const places = await page.evaluate(() => {
    const box = document.querySelector("mipvog-viewer")!.getBoundingClientRect();
    return Array.from(document.querySelectorAll("b"), (one) => {
      const { x, y, width, height } = one.getBoundingClientRect();
      return [x + width / 2 - box.x - box.width / 2, y + height / 2 - box.y - box.height / 2, getComputedStyle(one).visibility] as const;
    });
  });
  assert.ok(Math.abs(places[0][0]) < 1 && Math.abs(places[0][1]) < 1, `${places[0]}`);
  assert.ok(Math.abs(places[1][0]) < 1 && places[1][1] < -20, `${places[1]}`);
  assert.deepEqual(places.map(([, , visibility]) => visibility), ["visible", "visible", "hidden"]);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a context that is lost is told, and another one is made on request", async () => {
  const { page, element, problems } = await open();
  await element.evaluate((element) => element.stage!.orbit(0.5, 0));
  const chosen = await camera(element);
  const message = () => element.evaluate(({ shadowRoot }) => {
    const line = shadowRoot!.querySelector("p")!;
    return line.hidden ? "" : line.textContent!;
  });
  assert.equal(await message(), "");
  const told = element.evaluate((element) => new Promise<string>((done) => element.addEventListener("error", (event) => done((event as unknown as CustomEvent).detail.message))));
  await element.evaluate(({ stage }) => stage!.renderer.getContext().getExtension("WEBGL_lose_context")!.loseContext());
  assert.match(await told, /taken away/);
  assert.match(await message(), /taken away.*Try again/);
  await element.evaluate(({ shadowRoot }) => shadowRoot!.querySelector("button")!.click());
  await whole(page, element);
  assert.equal(await message(), "");
  const after = await camera(element);
  after.forEach((value, axis) => assert.ok(Math.abs(value - chosen[axis]) < 1e-6, `${after} after ${chosen}`));
  assert.deepEqual(problems.filter((problem) => !/context lost|lose_context/i.test(problem)), []);
  await page.close();
});

night("an element returns to its first view, gives its picture, and has parts to style", async () => {
  const { page, element, problems } = await open();
  const framed = await camera(element);
  await element.evaluate((element) => element.stage!.orbit(0.5, 0));
  await element.evaluate((element) => element.reset());
  const back = await camera(element);
  back.forEach((value, axis) => assert.ok(Math.abs(value - framed[axis]) < 1e-6, `${back} for ${framed}`));
  await whole(page, element);
  const type = await element.evaluate(async (element) => (await element.toBlob())?.type);
  assert.equal(type, "image/png");
  const parts = await element.evaluate(({ shadowRoot }) => Array.from(shadowRoot!.querySelectorAll("[part]"), (one) => one.part.value));
  assert.deepEqual(parts.sort(), ["message", "picture", "poster"]);
  assert.deepEqual(problems, []);
  await page.close();
});
