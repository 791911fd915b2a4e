/** A page with both renderers of three.js and two fields, for the tests of a file. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before } from "node:test";
import type { Browser, Page } from "playwright-core";
import { CountingServer, launchWebGPU, newPage, openOther, ROOT } from "./support.js";

/** The page and the addresses of its fields; all are there when tests run. */
export interface Scenes {
  page: Page;
  harmonics: string;
  tiny: string;
  /** What the page has complained of since the last call. */
  wrong(): string[];
}

/** Opens the page before the tests of a file, and closes it after them. */
export function scenesOfPage(): Scenes {
  const server = new CountingServer();
  let browser: Browser;
  let problems: string[] = [];
  const scenes = { wrong: () => problems.splice(0) } as Scenes;
  before(async () => {
    await server.start();
    const offer = (name: string) => server.offer(`${name}.mipvog`, readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
    [scenes.harmonics, scenes.tiny] = [offer("harmonics"), offer("tiny.rate")];
    browser = await launchWebGPU();
    const opened = await newPage(browser);
    [scenes.page, problems] = [opened.page, opened.problems];
    await openOther(scenes.page, server, "webgpu");
  });
  after(async () => {
    await browser.close();
    server.stop();
  });
  return scenes;
}
