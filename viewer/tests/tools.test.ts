/** The page's tools: links to views, pictures, ways to move, focus, comparison, keys. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { RadianceField } from "../src/index.js";
import { CountingServer, launch, newPage, night, ready, ROOT } from "./support.js";

const TINY = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
const OTHER = join(ROOT, "fixtures", "baked", "harmonics.mipvog");
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

async function open(more = "", reducedMotion: "reduce" | "no-preference" = "reduce"): Promise<{ page: Page; problems: string[] }> {
  const made = await newPage(browser, { width: 480, height: 300 });
  await made.page.emulateMedia({ reducedMotion });
  await made.page.goto(server.page("tiny.mipvog", bytes) + more);
  await ready(made.page);
  await made.page.focus("#picture");
  return made;
}

/** Position and target, rounded. */
function view(page: Page): Promise<number[]> {
  return page.evaluate(() => {
    const { position, target } = window.__mipvog.stage.viewpoint;
    return [...position.toArray(), ...target.toArray()].map((value) => Math.round(value * 1e3) / 1e3);
  });
}

const distance = (a: number[], b: number[]) => Math.hypot(...a.map((value, axis) => value - b[axis]));

test("an address names a camera file, and what is wrong with it is told", async () => {
  const file = { camera_angle_x: 0.7, frames: [{ file_path: "./test/r_7", transform_matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]] }] };
  server.offer("cameras.json", Buffer.from(JSON.stringify(file)));
  const { page, problems } = await open("&cameras=cameras.json");
  await page.locator("#views option", { hasText: "r_7" }).waitFor({ state: "attached" });
  assert.deepEqual(problems, []);
  await page.goto(`${server.page("tiny.mipvog", bytes)}&cameras=missing.json`);
  await page.waitForFunction(() => window.__mipvog?.error);
  assert.match(await page.locator("#error").innerText(), /camera file missing\.json cannot be had: its server answers 404/);
  await page.close();
});

test("the file has its own name, and a link leads to the same view", async () => {
  const { page, problems } = await open("&name=lego%20house.mipvog");
  assert.equal(await page.locator("#name").textContent(), "lego house.mipvog");
  assert.match(await page.title(), /^lego house\.mipvog/);
  assert.equal(new URL(page.url()).hash, "");
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("+");
  await page.evaluate(() => (window.__mipvog.stage.fov = 55));
  await page.waitForFunction(() => location.hash.startsWith("#view=") && location.hash.endsWith(",55"));
  const before = await view(page);
  await page.reload();
  await ready(page);
  assert.ok(distance(await view(page), before) < 0.01);
  assert.equal(await page.evaluate(() => window.__mipvog.stage.fov), 55);
  await page.keyboard.press("r");
  assert.deepEqual(problems, []);
  await page.close();
});

test("the tool bar is one stop of the Tab key, and arrows go from tool to tool", async () => {
  const { page, problems } = await open();
  const focused = () => page.evaluate(() => (document.activeElement as HTMLElement).dataset.tool);
  assert.equal(await page.locator('#tools button[tabindex="0"]').count(), 1);
  await page.locator('[data-tool="reset"]').focus();
  const before = await view(page);
  await page.keyboard.press("ArrowRight");
  assert.equal(await focused(), "rotate");
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowLeft");
  assert.equal(await focused(), "help");
  await page.keyboard.press("Home");
  assert.equal(await focused(), "reset");
  // They do not move the camera.
  assert.deepEqual(await view(page), before);
  assert.equal(await page.locator('#tools button[tabindex="0"]').count(), 1);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a link to another view of the page goes there, and the controls say what it is", async () => {
  const { page, problems } = await open();
  await page.keyboard.press("v");
  assert.equal(await page.locator("#way").textContent(), "Fly");
  await page.evaluate(() => (location.hash = "#view=1,2,3,0,0.5,0,70"));
  await page.waitForFunction(() => window.__mipvog.stage.fov === 70);
  assert.deepEqual(await view(page), [1, 2, 3, 0, 0.5, 0]);
  assert.equal(await page.locator("#way").textContent(), "Orbit");
  assert.equal(await page.locator("#fov").inputValue(), "70");
  assert.deepEqual(problems, []);
  await page.close();
});

test("a wrong file leaves the scene, its name and its view", async () => {
  const { page } = await open();
  const before = await view(page);
  await page.evaluate(() => {
    const transfer = new DataTransfer();
    transfer.items.add(new File(["words, and no container at all"], "wrong.png"));
    document.querySelector("#picture")!.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  });
  await page.waitForFunction(() => window.__mipvog.error);
  await page.locator("#error").getByText("Close").click();
  assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), 0);
  assert.equal(await page.locator("#name").textContent(), "tiny.mipvog");
  assert.deepEqual(await view(page), before);
  await page.close();
});

test("pictures are saved, and keys are shown", async () => {
  const { page, problems } = await open();
  const [download] = await Promise.all([page.waitForEvent("download"), page.keyboard.press("p")]);
  assert.equal(download.suggestedFilename(), "tiny.png");
  const picture = readFileSync(await download.path());
  // As many pixels as the page shows.
  assert.deepEqual([picture.readUInt32BE(16), picture.readUInt32BE(20)], [480, 300]);
  assert.ok(picture.length > 1000, `${picture.length} bytes`);
  await page.keyboard.press("?");
  assert.ok(await page.locator("#help").isVisible());
  await page.keyboard.press("Escape");
  await page.keyboard.press("f");
  await page.waitForFunction(() => document.fullscreenElement);
  await page.keyboard.press("f");
  await page.waitForFunction(() => !document.fullscreenElement);
  assert.deepEqual(problems, []);
  await page.close();
});

night("it turns by itself, flies and walks", async () => {
  const { page, problems } = await open();
  const start = await view(page);
  await page.keyboard.press("t");
  await page.waitForFunction((x) => Math.abs(window.__mipvog.stage.camera.position.z - x) > 0.01, start[2]);
  await page.keyboard.press("t");
  for (const way of ["Fly", "Walk"]) {
    await page.keyboard.press("v");
    assert.equal(await page.locator("#way").textContent(), way);
    const before = await page.evaluate(() => window.__mipvog.stage.camera.position.toArray());
    await page.keyboard.down("w");
    await page.waitForFunction(([x]) => Math.abs(window.__mipvog.stage.camera.position.x - x) > 0.05, before);
    await page.keyboard.up("w");
    const after = await page.evaluate(() => window.__mipvog.stage.camera.position.toArray());
    assert.equal(Math.abs(after[1] - before[1]) < 1e-6, way === "Walk", `${way}: ${before} to ${after}`);
  }
  await page.keyboard.press("v");
  assert.equal(await page.locator("#way").textContent(), "Orbit");
  await page.keyboard.press("r");
  assert.ok(distance(await view(page), start) < 0.01);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a double click turns around what is there, and the hand's move goes on unless motion is unwanted", async () => {
  const { page } = await open();
  const before = await view(page);
  await page.mouse.dblclick(225, 140);
  await page.waitForFunction(([x, y, z]) => window.__mipvog.stage.viewpoint.target.distanceTo({ x, y, z } as never) > 1e-3, before.slice(3));
  const box = await page.evaluate(() => {
    const { field, stage } = window.__mipvog;
    const { min, max } = field!.bounds.applyMatrix4(field!.matrixWorld);
    return { min: min.toArray(), max: max.toArray(), at: stage.viewpoint.target.toArray() };
  });
  box.at.forEach((value, axis) => assert.ok(value > box.min[axis] - 0.01 && value < box.max[axis] + 0.01, JSON.stringify(box)));
  assert.equal(await page.evaluate(() => window.__mipvog.stage.controls.enableDamping), false);
  await page.emulateMedia({ reducedMotion: "no-preference" });
  await page.waitForFunction(() => window.__mipvog.stage.controls.enableDamping);
  await page.close();
});

night("cameras of a file are offered, and the ground and the legend follow", async () => {
  const { page, problems } = await open();
  const choose = async (button: string, name: string, content: Buffer) => {
    const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.evaluate((button) => document.querySelector<HTMLElement>(button)!.click(), button)]);
    await chooser.setFiles({ name, mimeType: "", buffer: content });
  };
  const frame = { file_path: "./test/r_7", transform_matrix: [[0, -0.5, 0.866, 3.5], [1, 0, 0, 0], [0, 0.866, 0.5, 2.2], [0, 0, 0, 1]] };
  await choose("#cameras", "cameras.json", Buffer.from(JSON.stringify({ camera_angle_x: 0.7, frames: [frame] })));
  await page.locator("#panel > summary").click();
  await page.keyboard.press("v");
  await page.locator("#views").selectOption({ label: "r_7" });
  assert.equal(await page.locator("#way").textContent(), "Orbit");
  assert.equal(await page.locator("#fov").inputValue(), "40");
  const [x, y, z] = await view(page);
  // Training's z is the world's y.
  assert.ok(distance([x, y, z], [3.5, 2.2, 0]) < 0.01, `${[x, y, z]}`);
  await page.locator("#background").fill("#336699");
  await page.waitForFunction(() => window.__mipvog.ready);
  assert.equal(await page.evaluate(() => `#${(window.__mipvog.stage.scene.background as unknown as { getHexString(): string }).getHexString()}`), "#336699");
  await page.locator("#colors").check();
  assert.match((await page.locator("#legend").textContent())!, /Level 0, the finest/);
  await choose("#cameras", "cameras.json", Buffer.from("{}"));
  await page.waitForFunction(() => /no list frames/.test(window.__mipvog.error ?? ""));
  assert.deepEqual(problems, []);
  await page.close();
});

night("a file beside another one follows the chosen level and colours, as far as it has levels", async () => {
  const { page, problems } = await open();
  await page.locator("#panel > summary").click();
  await page.locator("#numbers > summary").click();
  const coarsest = (await page.locator("#level option").count()) - 2;
  await page.locator("#level").selectOption(String(coarsest));
  await page.locator("#colors").check();
  const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.evaluate(() => document.querySelector<HTMLElement>("#beside")!.click())]);
  await chooser.setFiles({ name: "other.mipvog", mimeType: "", buffer: readFileSync(OTHER) });
  await page.waitForFunction(() => window.__mipvog.stage.painter.split !== null && window.__mipvog.ready);
  const other = await page.evaluate(() => {
    const [field] = window.__mipvog.stage.painter.split!.right.children as RadianceField[];
    const { fixedLevel, showLevels, material, metadata } = field;
    return { fixedLevel, showLevels, drawn: material.uniforms.u_fixedLevel.value, last: metadata!.levels.length - 1 };
  });
  assert.deepEqual([other.fixedLevel, other.showLevels], [coarsest, true]);
  assert.equal(other.drawn, Math.min(coarsest, other.last));
  // No level beyond the coarsest reaches the shader.
  await page.evaluate(() => {
    window.__mipvog.field!.fixedLevel = 31;
    window.__mipvog.stage.redraw();
  });
  await page.waitForFunction((coarsest) => window.__mipvog.ready && window.__mipvog.field!.material.uniforms.u_fixedLevel.value === coarsest, coarsest);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a frame has no tools, its own view and a poster, and turns by itself", async () => {
  server.offer("poster.png", Buffer.from("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4//8/AAX+Av4N70a4AAAAAElFTkSuQmCC", "base64"));
  const { page, problems } = await newPage(browser, { width: 480, height: 300 });
  await page.goto(`${server.page("tiny.mipvog", bytes)}&ui=0&autorotate&poster=poster.png&camera=3,1,0,0,0,0,50&background=rgb(16,32,48)`);
  // What turns is never at rest.
  await page.waitForFunction(() => window.__mipvog?.firstPicture);
  assert.equal(await page.locator("#panel, #tools").evaluateAll((all) => all.every((one) => getComputedStyle(one).display === "none")), true);
  assert.equal(await page.evaluate(() => window.__mipvog.stage.controls.autoRotate), true);
  assert.equal(await page.locator("#poster").isHidden(), true);
  assert.equal(await page.evaluate(() => window.__mipvog.stage.fov), 50);
  assert.equal(await page.locator("#background").inputValue(), "#102030");
  assert.deepEqual(problems, []);
  await page.close();
});

test("keys work before a click, points are measured, and the box around them is an option of the program", async () => {
  const { page, problems } = await open();
  await page.evaluate(() => (document.activeElement as HTMLElement).blur());
  await page.keyboard.press("m");
  const card = page.locator("#measure");
  await card.waitFor();
  for (const [x, y] of [[240, 130], [260, 165]]) await page.mouse.click(x, y);
  const code = page.locator("#measured code");
  await code.waitFor();
  const [line, length] = [await code.innerText(), await card.locator("p").innerText()];
  const box = /^mipvog-bake transcode tiny\.mipvog --crop=([-\d.e,]+) -o cropped\.mipvog$/.exec(line)![1].split(",").map(Number);
  assert.equal(box.length, 6);
  const diagonal = Math.hypot(box[3] - box[0], box[4] - box[1], box[5] - box[2]);
  assert.ok(diagonal > 0.05 && Math.abs(Number(length.split(": ")[1]) - diagonal) < 1e-2 * diagonal, `${length} of ${diagonal}`);
  const bounds = await page.evaluate(() => [...window.__mipvog.field!.bounds.min.toArray(), ...window.__mipvog.field!.bounds.max.toArray()]);
  box.forEach((value, i) => assert.ok(value >= bounds[i % 3] && value <= bounds[3 + (i % 3)]));
  await page.locator("#unmeasure").click();
  assert.match(await card.innerText(), /^Click points/);
  await page.focus("#picture");
  await page.keyboard.press("m");
  assert.ok(await card.isHidden());
  assert.deepEqual(problems.filter((problem) => !problem.includes("ReadPixels")), []);
  await page.close();
});

test("the code for a page is a frame with this view", async () => {
  const { page } = await open("", "reduce");
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await page.evaluate(() => (document.querySelector<HTMLDetailsElement>("#panel")!.open = true));
  await page.locator("#embed").click();
  await page.locator("#said", { hasText: "copied" }).waitFor();
  const frame = await page.evaluate(() => navigator.clipboard.readText());
  assert.match(frame, /^<iframe src="http:\/\/127\.0\.0\.1:\d+\/\?file=tiny\.mipvog&amp;ui=0(#view=[-\d.,]+)?" title="tiny\.mipvog" width="800" height="533" allow="fullscreen; xr-spatial-tracking" loading="lazy"><\/iframe>$/);
  await page.close();
});

night("two files share a picture, each on its side", async () => {
  server.offer("other.mipvog", readFileSync(OTHER));
  const { page, problems } = await open("&compare=other.mipvog");
  await page.waitForFunction(() => window.__mipvog.stage.painter.split !== null && window.__mipvog.ready);
  /** The picture's left and right half. */
  const halves = async (at: number) => {
    await page.evaluate((at) => {
      const slider = document.querySelector<HTMLInputElement>("#at")!;
      slider.value = String(at);
      slider.dispatchEvent(new Event("input"));
    }, at);
    await ready(page);
    return page.evaluate(() => {
      const gl = window.__mipvog.stage.renderer.getContext();
      const [width, height] = [gl.drawingBufferWidth / 2, gl.drawingBufferHeight];
      return [0, width].map((x) => {
        const pixels = new Uint8Array(4 * width * height);
        gl.readPixels(x, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return Array.from(pixels).join();
      });
    });
  };
  const [first, second, both] = [await halves(1000), await halves(0), await halves(500)];
  assert.deepEqual(await page.locator("#line span").allInnerTexts(), ["tiny.mipvog", "other.mipvog"]);
  assert.ok(first[0] !== second[0] && first[1] !== second[1]);
  assert.ok(both[0] === first[0] && both[1] === second[1]);
  assert.deepEqual(problems, []);
  await page.close();
});
