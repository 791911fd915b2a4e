/** The page at every size: what covers what, contrast, targets, and what axe-core finds. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { after, before } from "node:test";
import type { Browser, Page } from "playwright-core";
import { CountingServer, launch, newPage, night, ready, ROOT } from "./support.js";

const TINY = join(ROOT, "fixtures", "baked", "tiny.rate.mipvog");
const AXE = createRequire(import.meta.url).resolve("axe-core/axe.min.js");
const SIZES = [
  [1280, 800],
  [800, 600],
  [640, 420],
  [360, 740],
] as const;
/** A side of what a finger meets, in pixels. */
const TARGET = 44;
let server: CountingServer;
let browser: Browser;

before(async () => {
  server = new CountingServer();
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
});

/** What axe-core finds. */
function findings(page: Page): Promise<string[]> {
  return page.evaluate(async () => {
    const { axe } = window as unknown as { axe: { run(): Promise<{ violations: { id: string; nodes: { html: string }[] }[] }> } };
    return (await axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html).join(" ")}`);
  });
}

/** Controls that are smaller than a finger. */
function small(page: Page): Promise<string[]> {
  return page.evaluate((least) => {
    const controls = Array.from(document.querySelectorAll<HTMLElement>("button, select, input, summary"));
    return controls.flatMap((control) => {
      // A label around a control is pressed as well as the control.
      const { width, height } = (control.closest("label.check") ?? control).getBoundingClientRect();
      const isSeen = control.checkVisibility({ checkVisibilityCSS: true }) && width > 0;
      return isSeen && (width < least || height < least) ? [`${control.outerHTML}: ${width} x ${height}`] : [];
    });
  }, TARGET);
}

/** The ids of what lies on top at these shares of an element's box. */
function onTop(page: Page, selector: string, shares: number[]): Promise<string[]> {
  return page.evaluate(
    ([selector, shares]) => {
      const { left, top, width, height } = document.querySelector(selector)!.getBoundingClientRect();
      return shares.map((share) => document.elementFromPoint(left + share * width, top + share * height)?.closest("[id]")?.id ?? "");
    },
    [selector, shares] as const,
  );
}

/** Contrast of the edge of controls against what is behind them. */
function edges(page: Page): Promise<number> {
  return page.evaluate(() => {
    const channels = (text: string) => text.match(/[\d.]+/g)!.slice(0, 3).map((value) => Number(value) / 255);
    const light = (color: string) => {
      const [r, g, b] = channels(color).map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
      return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
    };
    const edge = getComputedStyle(document.querySelector("#another")!).borderTopColor;
    const card = getComputedStyle(document.querySelector("#panel")!).backgroundColor;
    const [a, b] = [light(edge), light(card)];
    return Math.max(a, b) / Math.min(a, b);
  });
}

for (const [width, height] of SIZES) {
  night(`nothing covers what matters at ${width} x ${height}`, async () => {
    for (const scheme of ["light", "dark"] as const) {
      const { page, problems } = await newPage(browser, { width, height });
      await page.emulateMedia({ colorScheme: scheme });
      const check = async (where: string) => {
        await page.addScriptTag({ path: AXE });
        assert.deepEqual(await findings(page), [], `${scheme}, ${where}`);
        assert.deepEqual(await small(page), [], `${scheme}, ${where}`);
      };
      await page.goto(server.origin);
      await page.waitForFunction(() => window.__mipvog?.stage);
      assert.deepEqual(await onTop(page, "#open", [0.1, 0.5, 0.9]), ["open", "open", "open"]);
      const ground = await page.evaluate(() => getComputedStyle(document.querySelector("main")!).backgroundColor);
      assert.equal(Number(ground.match(/\d+/)![0]) < 128, scheme === "dark", ground);
      await check("start");
      await page.goto(server.page("tiny.mipvog", readFileSync(TINY)));
      // The full picture is not needed, and takes long in software.
      await page.waitForFunction(() => window.__mipvog?.firstPicture);
      await page.evaluate(() => (document.querySelector<HTMLDetailsElement>("#panel")!.open = true));
      assert.deepEqual(await onTop(page, "#picture", [0.5]), ["picture"]);
      assert.ok((await edges(page)) >= 3, `${await edges(page)} to 1`);
      await check("loaded");
      await page.goto(server.page("broken.mipvog", Buffer.from("no container at all, but some words")));
      await page.waitForFunction(() => window.__mipvog.error);
      assert.deepEqual(await onTop(page, "#error", [0.1, 0.5, 0.9]), ["error", "error", "error"]);
      await check("error");
      assert.deepEqual(problems, []);
      await page.close();
    }
  });
}

night("the subject fills the picture, in its middle", async () => {
  const { page } = await newPage(browser, { width: 640, height: 400 });
  await page.goto(server.page("tiny.mipvog", readFileSync(TINY)));
  await ready(page);
  const box = await page.evaluate(() => {
    const { stage, field } = window.__mipvog;
    const { min, max } = field!.visibleBounds.applyMatrix4(field!.matrixWorld);
    const corners = Array.from({ length: 8 }, (_, corner) => min.clone().set(corner & 1 ? max.x : min.x, corner & 2 ? max.y : min.y, corner & 4 ? max.z : min.z));
    const at = corners.map((corner) => corner.project(stage.camera));
    return { wide: Math.max(...at.map(({ x }) => Math.abs(x))), high: Math.max(...at.map(({ y }) => Math.abs(y))) };
  });
  assert.ok(Math.max(box.wide, box.high) > 0.85 && Math.max(box.wide, box.high) <= 0.95, JSON.stringify(box));
  await page.close();
});
