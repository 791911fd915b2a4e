/** What the tests share: a server that counts, a browser, the program, and pictures. */

import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, renameSync, rmSync, statSync } from "node:fs";
import { createServer, type IncomingMessage, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { test } from "node:test";
import { gzipSync } from "node:zlib";
import { type Browser, chromium, type Frame, type Page } from "playwright-core";
import type {} from "../page/viewer.js";

/** The repository; tests run in `viewer/`. */
export const ROOT = join(process.cwd(), "..");
const DIST = join(process.cwd(), "dist");
const TYPES: Record<string, string> = { html: "text/html", js: "text/javascript", css: "text/css", png: "image/png" };

/** A test that takes long, for `npm run test:night`: `npm test` leaves it out. */
export const night = (process.env.MIPVOG_NIGHT ? test : test.skip) as typeof test;

/** The program, built before: `MIPVOG_BAKE`, or cargo's debug build. */
export function program(...parameters: string[]): string {
  return execFileSync(programPath(), parameters, { encoding: "utf8", cwd: ROOT, stdio: ["ignore", "pipe", "inherit"] });
}

export function programPath(): string {
  const target = process.env.CARGO_TARGET_DIR ?? join(ROOT, "target");
  const path = process.env.MIPVOG_BAKE ?? join(target, "debug", "mipvog-bake");
  if (!existsSync(path)) throw new Error(`${path} is not there: build the program first, with cargo build`);
  return path;
}

/** A baked scene, and the asset that is written beside it. */
export interface Baked {
  container: string;
  asset: string;
}

const LEGO = ["lego64", "--stepsize", "0.5", "--near", "2", "--far", "6"];

/** A scene, trained from 2 to 6 units away, or a smaller one: baked once for all files of tests. */
export function bakedScene(name: "lego" | "tiny"): Baked {
  const [scene, ...options] = name === "lego" ? LEGO : ["tiny"];
  const folder = join("build", "tests", "baked", name);
  const files = (folder: string): Baked => ({ container: resolve(folder, "field.mipvog"), asset: resolve(folder, "field.glb") });
  if (!existsSync(folder)) {
    // Files of tests run beside each other: what another one has baked meanwhile is as good.
    mkdirSync(join("build", "tests", "baked"), { recursive: true });
    const own = mkdtempSync(`${folder}.`);
    program("bake", join(ROOT, "fixtures", "trained", scene, "fine_last.tar"), ...options, "-o", files(own).container, "--gltf", files(own).asset);
    try {
      renameSync(own, folder);
    } catch {
      rmSync(own, { recursive: true });
    }
  }
  return files(folder);
}

/** A folder that is gone after the tests. */
export function temporaryFolder(): { path: string; remove(): void } {
  const path = mkdtempSync(join(tmpdir(), "mipvog-viewer-"));
  return { path, remove: () => rmSync(path, { recursive: true, force: true }) };
}

/** A server of a folder with the page, and of files, which counts the files' bytes. */
export class CountingServer {
  /** Bytes of files that were sent. */
  sent = 0;
  /** Whether ranges are answered; else the whole file is. */
  ranges = true;
  /** Bytes that an answer to a range has at most. */
  most = Infinity;
  /** Whether files lie on the server compressed, so that it can only send what is compressed. */
  compressed = false;
  /** What a request for a file has to have as `Authorization`; null for nothing. */
  login: string | null = null;
  /** Requests for files: their paths, and whether each had a cookie. */
  readonly asked: { path: string; cookie: boolean }[] = [];
  /** How many of the next requests for files are answered by 503. */
  failing = 0;
  /** After so many bytes of the next answer to a range nothing comes, until `snap`. */
  breaking: number | null = null;
  /** Breaks the connection that `breaking` has halted. */
  snap: () => void = () => {};
  /** Where answers to ranges begin and end, one after the other. */
  readonly starts: number[] = [];
  readonly ends: number[] = [];
  /** Headers of every answer. */
  headers: Record<string, string> = {};
  /** Requests of bytes beyond this wait until it grows. */
  gate = Infinity;
  private tell: (told: unknown) => void = () => {};
  private readonly waiting: { to: number; go: () => void }[] = [];
  private readonly files = new Map<string, Buffer>();
  private readonly server = createServer((request, response) => this.answer(request, response));

  constructor(private readonly folder = DIST) {}

  async start(): Promise<void> {
    await new Promise<void>((ready) => this.server.listen(0, "127.0.0.1", ready));
  }

  stop(): void {
    this.server.closeAllConnections();
    this.server.close();
  }

  /** The page's address with a file to open. */
  page(name: string, bytes: Buffer): string {
    this.offer(name, bytes);
    return `${this.origin}/?file=${name}`;
  }

  /** A file's own address. */
  offer(name: string, bytes: Buffer): string {
    this.files.set(`/${name}`, bytes);
    return `${this.origin}/${name}`;
  }

  get origin(): string {
    return `http://127.0.0.1:${(this.server.address() as AddressInfo).port}`;
  }

  open(gate: number): void {
    this.gate = gate;
    for (const { to, go } of this.waiting.splice(0)) this.before(to, go);
  }

  private before(to: number, go: () => void): void {
    if (to <= this.gate) go();
    else this.waiting.push({ to, go });
  }

  /** The next thing that a page tells by a request of its own. */
  told(): Promise<unknown> {
    return new Promise((tell) => (this.tell = tell));
  }

  private take(request: IncomingMessage, response: ServerResponse): void {
    const parts: Buffer[] = [];
    request.on("data", (part: Buffer) => parts.push(part));
    request.on("end", () => {
      this.tell(JSON.parse(Buffer.concat(parts).toString()));
      response.writeHead(204).end();
    });
  }

  private answer(request: IncomingMessage, response: ServerResponse): void {
    const path = new URL(request.url ?? "/", this.origin).pathname;
    if (request.method === "POST") return this.take(request, response);
    let bytes = this.files.get(path);
    for (const [name, value] of Object.entries(this.headers)) response.setHeader(name, value);
    if (!bytes) {
      const name = path === "/" ? "index.html" : path.slice(1);
      const file = join(this.folder, name);
      if (!/^\w+\.\w+$/.test(name) || !existsSync(file) || !statSync(file).isFile()) {
        response.writeHead(404).end();
        return;
      }
      response.writeHead(200, { "Content-Type": TYPES[name.split(".")[1]] }).end(readFileSync(file));
      return;
    }
    // Firefox runs no script of another type.
    if (path.endsWith(".js")) response.setHeader("Content-Type", TYPES.js);
    if (request.method === "OPTIONS") return void response.writeHead(204).end();
    this.asked.push({ path, cookie: request.headers.cookie !== undefined });
    if (this.login !== null && request.headers.authorization !== this.login && !path.endsWith(".html")) return void response.writeHead(401).end();
    if (this.compressed && !path.endsWith(".html")) {
      bytes = gzipSync(bytes);
      response.setHeader("Content-Encoding", "gzip");
    }
    if (this.failing > 0) {
      this.failing--;
      return void response.writeHead(503).end();
    }
    const range = this.ranges ? /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "") : null;
    if (!range) {
      this.sent += bytes.length;
      response.writeHead(200, { "Content-Length": bytes.length }).end(bytes);
      return;
    }
    const [from, to] = [Number(range[1]), Math.min(Number(range[2]) + 1, Number(range[1]) + this.most, bytes.length)];
    this.before(to, () => {
      this.sent += to - from;
      response.writeHead(206, { "Content-Range": `bytes ${from}-${to - 1}/${bytes.length}`, "Content-Length": to - from });
      this.starts.push(from);
      this.ends.push(to);
      if (this.breaking === null) return void response.end(bytes!.subarray(from, to));
      response.write(bytes!.subarray(from, from + this.breaking));
      this.snap = () => response.destroy();
      this.breaking = null;
    });
  }
}

const QUIET = ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];

/** Chromium from the system, drawing in software, or by what `ANGLE` names: "gl-egl" or "vulkan" for a graphics card. */
export async function launch(more: string[] = []): Promise<Browser> {
  const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
  const angle = process.env.ANGLE ?? "swiftshader";
  const backend = { swiftshader: ["--enable-unsafe-swiftshader"], vulkan: ["--enable-features=Vulkan", "--disable-vulkan-surface"] }[angle] ?? [];
  return chromium.launch({
    executablePath,
    args: ["--no-sandbox", "--use-gl=angle", `--use-angle=${angle}`, "--ignore-gpu-blocklist", ...backend, ...QUIET, ...more],
  });
}

/** Chromium with an adapter for WebGPU that draws in software. It shows nothing of what is drawn on canvases. */
export async function launchWebGPU(): Promise<Browser> {
  const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
  return chromium.launch({ executablePath, args: ["--no-sandbox", "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-unsafe-swiftshader", ...QUIET] });
}

/** A page that remembers what went wrong in it. */
export async function newPage(browser: Browser, size = { width: 400, height: 300 }): Promise<{ page: Page; problems: string[] }> {
  const page = await browser.newPage({ viewport: size });
  page.setDefaultTimeout(120_000);
  const problems: string[] = [];
  page.on("pageerror", (error) => problems.push(`page error: ${error.message}`));
  page.on("console", (message) => {
    // Browsers warn of slowness where tests read pixels.
    if (message.text().includes("GPU stall due to ReadPixels")) return;
    if (["error", "warning"].includes(message.type())) problems.push(`${message.type()}: ${message.text()}`);
  });
  return { page, problems };
}

/** Opens an empty page with a script of `tests/others/`. */
export async function openOther(page: Page, server: CountingServer, name: string): Promise<void> {
  await page.goto(server.offer("blank.html", Buffer.from('<!doctype html><link rel="icon" href="data:,">')));
  await page.addScriptTag({ path: join("build", "tests", "others", `${name}.js`), type: "module" });
  await page.waitForFunction(() => ["draw", "list", "drawBabylon", "lib", "babylon", "gpu", "drawBoth", "refuse"].some((name) => name in window));
}

/** Takes the graphics device from the page; what gives it back. */
export async function loseDevice(page: Page): Promise<() => Promise<void>> {
  const lost = await page.evaluateHandle(() => {
    const canvas = document.querySelector("canvas")!;
    const lost = window.__mipvog.stage.renderer.getContext().getExtension("WEBGL_lose_context")!;
    const gone = new Promise((resolve) => canvas.addEventListener("webglcontextlost", resolve));
    lost.loseContext();
    return gone.then(() => lost);
  });
  return () =>
    page.evaluate((lost) => {
      const back = new Promise<void>((resolve) => document.querySelector("canvas")!.addEventListener("webglcontextrestored", () => resolve()));
      lost.restoreContext();
      return back;
    }, lost);
}

/** Waits until everything is loaded and drawn, or throws what the page says went wrong. */
export async function ready(page: Page | Frame): Promise<void> {
  await page.waitForFunction(() => window.__mipvog?.ready || window.__mipvog?.error);
  const error = await page.evaluate(() => window.__mipvog.error);
  if (error) throw new Error(error);
}

/** A camera of a camera file. */
export interface View {
  width: number;
  height: number;
  toWorld: number[][];
  focal: number;
  /** Not limited by the file's near and far, as `render` sees with cameras of its own. */
  seesAll?: boolean;
}

/** Cameras of a NeRF-synthetic file, as `render --size SIZExSIZE` sees them. */
export function views(path: string, size: number): View[] {
  const file = JSON.parse(readFileSync(path, "utf8"));
  const focal = (0.5 * size) / Math.tan(0.5 * file.camera_angle_x);
  return file.frames.map((frame: { transform_matrix: number[][] }) => ({ width: size, height: size, toWorld: frame.transform_matrix, focal }));
}

/** Cameras on a circle, as `render --turntable`. */
export function turntable(bounds: { min: number[]; max: number[] }, count: number, size: number): View[] {
  const middle = bounds.min.map((min, axis) => (min + bounds.max[axis]) / 2);
  const radius = 0.5 * Math.hypot(...bounds.min.map((min, axis) => bounds.max[axis] - min));
  const [half, up] = [0.35, Math.PI / 6];
  return Array.from({ length: count }, (_, i) => {
    const around = (2 * Math.PI * i) / count;
    const back = [Math.cos(around) * Math.cos(up), Math.sin(around) * Math.cos(up), Math.sin(up)];
    const right = [-Math.sin(around), Math.cos(around), 0];
    const above = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    const row = (axis: number) => [right[axis], above[axis], back[axis], middle[axis] + (radius / Math.sin(half)) * back[axis]];
    return { width: size, height: size, toWorld: [row(0), row(1), row(2), [0, 0, 0, 1]], focal: (0.5 * size) / Math.tan(half), seesAll: true };
  });
}

/** Numbers from 0 to below `end`, by a congruential generator. */
export function numbers(seed: number): (end: number) => number {
  let state = seed;
  return (end) => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return Math.floor((state / 2 ** 32) * end);
  };
}

/** A zstd frame of one block, of at most 128 kB of stored bytes. */
export function storedFrame(bytes: Uint8Array): Uint8Array {
  const head = new DataView(new ArrayBuffer(12));
  head.setUint32(0, 0xfd2fb528, true);
  // One segment; its size in 4 bytes, of which the block's head repeats three.
  head.setUint8(4, 0xa0);
  head.setUint32(5, bytes.length, true);
  const block = (bytes.length << 3) | 1;
  head.setUint16(9, block & 0xffff, true);
  head.setUint8(11, block >> 16);
  return Uint8Array.from([...new Uint8Array(head.buffer), ...bytes]);
}

/** The page's picture of a view, four bytes a pixel. */
export async function capture(page: Page | Frame, view: View): Promise<number[]> {
  return page.evaluate((view) => window.__mipvog.capture(view), view);
}

/** A PNG's pixels, four bytes each, as the browser reads them. */
export async function pixels(page: Page, path: string): Promise<number[]> {
  return page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }), { colorSpaceConversion: "none" });
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    return Array.from(context.getImageData(0, 0, picture.width, picture.height).data);
  }, readFileSync(path, "base64"));
}

/** Peak signal-to-noise ratio of the colours of two pictures, in dB. */
export function psnr(a: number[], b: number[]): number {
  if (a.length !== b.length || a.length === 0) throw new Error(`pictures of ${a.length} and ${b.length} bytes`);
  let sum = 0;
  for (let i = 0; i < a.length; i++) if (i % 4 < 3) sum += ((a[i] - b[i]) / 255) ** 2;
  return -10 * Math.log10(sum / ((a.length / 4) * 3));
}
