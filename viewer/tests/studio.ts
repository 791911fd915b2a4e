/** A page with what scenes of three.js are made of (`others/scenes.ts`), and fields to put into them. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import type { Page } from "playwright-core";
import { bakedScene, CountingServer, launch, newPage, openOther, ROOT } from "./support.js";
import type {} from "./others/scenes.js";

export interface Studio {
  page: Page;
  /** A field with a network, trained from 2 to 6 units away; one with harmonics; an asset of the first. */
  lego: string;
  harmonics: string;
  asset: string;
  /** What went wrong since this was last asked. */
  wrong(): string[];
  close(): Promise<void>;
}

export async function openStudio(): Promise<Studio> {
  const server = new CountingServer();
  const baked = bakedScene("lego");
  await server.start();
  const lego = server.offer("lego.mipvog", readFileSync(baked.container));
  const asset = server.offer("lego.glb", readFileSync(baked.asset));
  const harmonics = server.offer("harmonics.mipvog", readFileSync(join(ROOT, "fixtures", "baked", "harmonics.mipvog")));
  const browser = await launch();
  const { page, problems } = await newPage(browser);
  await openOther(page, server, "scenes");
  const wrong = () => problems.splice(0);
  const close = async () => {
    await browser.close();
    server.stop();
  };
  return { page, lego, harmonics, asset, wrong, close };
}

/** How many pixels are not white ground. */
export function drawn(pixels: number[]): number {
  let count = 0;
  for (let at = 0; at < pixels.length; at += 4) count += Number(pixels.slice(at, at + 3).some((value) => value < 250));
  return count;
}
