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
