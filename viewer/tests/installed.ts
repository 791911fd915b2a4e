/** The package as it is installed, and pages that use it. */

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readdirSync } from "node:fs";
import type { Page } from "playwright-core";

/** Runs npm in a folder. */
export function npm(folder: string, ...parameters: string[]): string {
  return execFileSync("npm", parameters, { cwd: folder, encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] });
}

/** Packs the package into a folder; the name of the tarball. */
export function packed(folder: string): string {
  npm(process.cwd(), "pack", "--pack-destination", folder);
  return readdirSync(folder).find((name) => name.endsWith(".tgz"))!;
}

/** How many colours the page shows. */
async function colors(page: Page): Promise<number> {
  const data = (await page.screenshot()).toString("base64");
  return page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    return new Set(new Uint32Array(context.getImageData(0, 0, picture.width, picture.height).data.buffer)).size;
  }, data);
}

/** Waits for a picture; nothing that has gone wrong speaks of `trouble`. */
export async function showsAt(page: Page, problems: string[], name: string, trouble: string): Promise<void> {
  await page.goto(name);
  const end = Date.now() + 60_000;
  while ((await colors(page)) < 100) assert.ok(Date.now() < end, `${name} shows nothing: ${problems}`);
  // Warnings are the frameworks' own, of their habits and of slow machines.
  assert.deepEqual(problems.filter((problem) => problem.includes(trouble)), [], name);
  await page.close();
}
