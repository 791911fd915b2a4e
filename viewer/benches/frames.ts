/**
 * Measures how many pictures a second the page draws.
 *
 *     npm run bench:frames -- scene.mipvog [WIDTHxHEIGHT] [VIEWS]
 *
 * `ANGLE` names what draws (see tests/support.ts): a graphics card where there is one. Each distance has a circle of
 * views. Pictures in full are told to the device one after the other, and then waited for. Pictures of what moves are
 * those that the page itself draws, with the sharpness that it chooses.
 */

import { readFileSync } from "node:fs";
import { measureFloor } from "./floor.js";
import { CountingServer, launch, newPage, ready } from "../tests/support.js";

/** Distances, as shares of that from which the whole scene fills the picture. */
const DISTANCES = [1, 0.5, 2];
/** Circles that are drawn; the middle one of their times counts. */
const CIRCLES = 5;
/** A scene is turned by hand for this long, in milliseconds. */
const TURNED_MS = 3000;

const [file, size = "1920x1080", views = "60"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const server = new CountingServer();
await server.start();
const browser = await launch(["--disable-frame-rate-limit", "--disable-gpu-vsync"]);
const { page, problems } = await newPage(browser, { width, height });
page.setDefaultTimeout(600_000);
await page.goto(server.page("scene.mipvog", readFileSync(file)));
await ready(page);
const device = await page.evaluate(() => {
  const gl = window.__mipvog.stage.renderer.getContext();
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
});
const floor = await page.evaluate(measureFloor);
console.log(`${device}, ${width}x${height}`);
console.log(`its fragments: ${floor.arithmetic.toFixed(0)} billion multiplications with additions, ${floor.texels.toFixed(1)} billion filtered texels a second`);

for (const distance of DISTANCES) {
  const measured = await page.evaluate(
    async ({ distance, views, circles, turned, size }) => {
      const { stage } = window.__mipvog;
      const { viewpoint } = stage;
      const position = viewpoint.position.clone().sub(viewpoint.target).multiplyScalar(distance).add(viewpoint.target);
      stage.viewpoint = { ...viewpoint, position };
      const gl = stage.renderer.getContext();
      const circle = () => {
        const start = performance.now();
        for (let view = 0; view < views; view++) {
          stage.orbit((2 * Math.PI) / views, 0);
          stage.renderer.render(stage.scene, stage.camera);
        }
        // The answer needs the last picture, and so all of them.
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        return performance.now() - start;
      };
      circle();
      const times = Array.from({ length: circles }, circle).sort((a, b) => a - b);

      const sharpness: number[] = [];
      const before = stage.painter.drawn;
      stage.painter.drawn = () => sharpness.push(stage.painter.sharpness);
      const start = performance.now();
      await new Promise<void>((done) => {
        const turn = () => {
          if (performance.now() - start > turned) return done();
          stage.orbit(0.01, 0);
          requestAnimationFrame(turn);
        };
        turn();
      });
      const seconds = (performance.now() - start) / 1000;
      stage.painter.drawn = before;
      stage.viewpoint = viewpoint;
      // The page finds its sharpness in the first pictures.
      const late = sharpness.slice(sharpness.length >> 1);
      const mean = late.reduce((sum, value) => sum + value, 0) / Math.max(late.length, 1);
      return { full: (1000 * views) / times[circles >> 1], moving: sharpness.length / seconds, pixels: size.map((side) => Math.round(side * mean)) };
    },
    { distance, views: Number(views), circles: CIRCLES, turned: TURNED_MS, size: [width, height] },
  );
  const { full, moving, pixels } = measured;
  console.log(`${distance} of the distance: ${full.toFixed(1)} pictures a second in full; moving, ${moving.toFixed(1)} of ${pixels.join("x")} pixels`);
}
const work = await page.evaluate(() => window.__mipvog.statistics(true));
if (work) console.log(`${work.samplesPerRay.toFixed(1)} samples and ${work.fetchesPerRay.toFixed(1)} texture fetches a ray that meets the box`);
// The device waits for pictures that are asked for, as it should here.
for (const problem of problems) if (!problem.includes("ReadPixels")) console.log(problem);
await browser.close();
server.stop();
