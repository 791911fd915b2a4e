/**
 * Measures how the page loads a container on the software renderer, and how a drag feels.
 *
 *     npm run bench:page -- scene.mipvog [WIDTHxHEIGHT]
 *
 * A task holds the page's own thread. A frame is the time between two pictures of the browser, in which the device
 * draws as well: on the software renderer it shares the processor with everything else.
 */

import { readFileSync } from "node:fs";
import type { Page } from "playwright-core";
import { CountingServer, launch, newPage } from "../tests/support.js";

/** What a page counts, in milliseconds. */
interface Counts {
  tasks: number[];
  frames: number[];
}

/** The steps of a drag, and the time between two. */
const [DRAG_STEPS, STEP_MS] = [10, 50];
/** A picture at rest is sharp after this long. */
const REST_MS = 500;
/** A browser has started after this long. */
const STARTED_MS = 1500;

const [file, size = "1280x800"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const server = new CountingServer();
await server.start();
const browser = await launch();
const { page } = await newPage(browser, { width, height });
page.setDefaultTimeout(600_000);
await page.addInitScript(() => {
  const counts: Counts = { tasks: [], frames: [] };
  (window as unknown as { counts: Counts }).counts = counts;
  new PerformanceObserver((list) => counts.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask", buffered: true });
  let before = performance.now();
  const frame = (now: number) => {
    counts.frames.push(now - before);
    before = now;
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
});

/** Prints the longest task and frame since the last time. */
async function report(name: string, page: Page): Promise<void> {
  const longest = await page.evaluate(() => {
    const { counts } = window as unknown as { counts: Counts };
    const [tasks, frames] = [counts.tasks.splice(0), counts.frames.splice(0)];
    return { task: Math.max(0, ...tasks), frame: Math.max(0, ...frames), frames: frames.length };
  });
  console.log(`${name}: longest task ${longest.task.toFixed(0)} ms, longest of ${longest.frames} frames ${longest.frame.toFixed(0)} ms`);
}

// A browser that has just been started has a long frame of its own.
await page.goto(server.offer("empty.html", Buffer.from("<!doctype html>")));
await page.waitForTimeout(STARTED_MS);
const start = performance.now();
const since = () => `${((performance.now() - start) / 1000).toFixed(2)} s`;
await page.goto(server.page("scene.mipvog", readFileSync(file)));
await page.waitForFunction(() => window.__mipvog?.firstPicture);
console.log(`first picture: ${since()}`);
await page.waitForFunction(() => window.__mipvog.field?.finest === 0);
console.log(`level 0: ${since()}`);
const settled = () => page.waitForFunction(() => window.__mipvog.stage!.settled);
await settled();
console.log(`picture in full: ${since()}`);
await report("loading", page);
await page.mouse.move(width / 2, height / 2);
await page.mouse.down();
for (let step = 1; step <= DRAG_STEPS; step++) {
  await page.mouse.move(width / 2 + 10 * step, height / 2);
  await page.waitForTimeout(STEP_MS);
}
await page.mouse.up();
await page.waitForTimeout(REST_MS);
await settled();
await report("a drag and the full picture after it", page);
await browser.close();
server.stop();
