/**
 * Times frames of WebGPU beside those of WebGL, in the same browser and on the same processor.
 *
 *     npm run bench:webgpu
 *
 * Prints the middle ratio of pairs of frames for each kind of field: below 1, WebGPU is quicker.
 */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { CountingServer, launchWebGPU, newPage, openOther, ROOT } from "../tests/support.js";
import type {} from "../tests/others/webgpu.js";

/** Pairs of frames of which the middle ratio counts. */
const PAIRS = 9;

const server = new CountingServer();
await server.start();
const browser = await launchWebGPU();
const { page } = await newPage(browser);
await openOther(page, server, "webgpu");
for (const name of ["tiny.rate", "harmonics", "boxes"]) {
  const address = server.offer(`${name}.mipvog`, readFileSync(join(ROOT, "fixtures", "baked", `${name}.mipvog`)));
  const pairs = await page.evaluate(
    async ({ address, pairs }) => {
      const { THREE, sceneOf, rendererOf, cameraAt, load } = window.gpu;
      const { scene, field } = sceneOf(address);
      await field.opened;
      const target = new THREE.WebGLRenderTarget(96, 96, { type: THREE.HalfFloatType });
      const renderers = [await rendererOf("webgl"), await rendererOf("webgpu")];
      const cameras = renderers.map(() => (field.isWorld ? cameraAt([0.5, 0, 0.5], [-0.7, 0.2, -0.7]) : cameraAt([1.9, 0.9, 0.4])));
      for (const [i, renderer] of renderers.entries()) await load(renderer, scene, cameras[i]);
      const frame = async (number: number) => {
        const renderer = renderers[number];
        const start = performance.now();
        renderer.setRenderTarget(target);
        renderer.render(scene, cameras[number]);
        // The answer needs the last picture.
        if (number === 0) renderer.readRenderTargetPixels(target, 0, 0, 1, 1, new Uint16Array(4));
        else await (renderer as import("three/webgpu").WebGPURenderer).readRenderTargetPixelsAsync(target, 0, 0, 1, 1);
        return performance.now() - start;
      };
      for (const number of [0, 1, 0, 1]) await frame(number);
      const times = [];
      for (let pair = 0; pair < pairs; pair++) times.push(pair % 2 ? [await frame(0), await frame(1)] : [await frame(1), await frame(0)].reverse());
      field.dispose();
      renderers[0].dispose();
      await renderers[1].dispose();
      return times;
    },
    { address, pairs: PAIRS },
  );
  const ratios = pairs.map(([webgl, webgpu]) => webgpu / webgl).sort((a, b) => a - b);
  const middle = ratios[PAIRS >> 1];
  console.log(`${name}: WebGPU takes ${middle.toFixed(2)} of the time of WebGL (${pairs[0].map((time) => time.toFixed(0)).join(" and ")} ms at first)`);
}
await browser.close();
server.stop();
