/**
 * Compares the page's pictures with those of `mipvog-bake render`.
 *
 *     npm run bench:pictures -- scene.mipvog transforms_test.json [SIZE]
 *
 * `ANGLE` names what draws (see tests/support.ts), and `MIPVOG_BAKE` the program. Prints the mean and the least PSNR over
 * all cameras, at SIZE pixels a side and at a quarter of it.
 */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { capture, CountingServer, launch, newPage, pixels, program, psnr, ready, temporaryFolder, views } from "../tests/support.js";

const SCALES = [1, 4];

const [file, cameras, size = "400"] = process.argv.slice(2);
const side = Number(size);
const folder = temporaryFolder();
const reference = join(folder.path, "pictures");
program("render", file, "--cameras", cameras, "--size", `${side}x${side}`, "--scales", SCALES.join(), "-o", reference);
const names: string[] = JSON.parse(readFileSync(cameras, "utf8")).frames.map((frame: { file_path: string }) => frame.file_path.split("/").pop());

const server = new CountingServer();
await server.start();
const browser = await launch();
const { page, problems } = await newPage(browser);
await page.goto(server.page("scene.mipvog", readFileSync(file)));
await ready(page);
for (const scale of SCALES) {
  const found: number[] = [];
  for (const [i, view] of views(cameras, side).entries()) {
    const small = { ...view, width: side / scale, height: side / scale, focal: view.focal / scale };
    found.push(psnr(await capture(page, small), await pixels(page, join(reference, `${names[i]}.s${scale}.png`))));
  }
  const mean = found.reduce((sum, value) => sum + value, 0) / found.length;
  console.log(`${side / scale} pixels a side: ${mean.toFixed(1)} dB, the least ${Math.min(...found).toFixed(1)}`);
}
// The device waits for pictures that are asked for, as it should here.
for (const problem of problems) if (!problem.includes("ReadPixels")) console.log(problem);
await browser.close();
server.stop();
folder.remove();
