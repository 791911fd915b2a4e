/** How a container arrives: coarse to fine, in parts or whole, and what happens when it does not. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { bakedScene, capture, CountingServer, launch, loseDevice, newPage, night, pixels, program, psnr, ready, ROOT, temporaryFolder, views } from "./support.js";

const LEGO = join(ROOT, "fixtures", "trained", "lego64");
const CAMERAS = join(LEGO, "transforms_test.json");
const folder = temporaryFolder();
let container: string;
let bytes: Buffer;
let levels: { prefix_bytes: number }[];
let server: CountingServer;
let browser: Browser;

before(async () => {
  ({ container } = bakedScene("lego"));
  bytes = readFileSync(container);
  ({ levels } = JSON.parse(program("inspect", container, "--format", "json")));
  server = new CountingServer();
  await server.start();
  browser = await launch();
});

after(async () => {
  await browser.close();
  server.stop();
  folder.remove();
});

/** Waits until the finest level that is shown is this one. */
async function shows(page: Page, level: number): Promise<void> {
  await page.waitForFunction((level) => window.__mipvog?.field?.finest === level || window.__mipvog?.error, level);
  assert.equal(await page.evaluate(() => window.__mipvog.error), null);
}

night("the first picture needs a twentieth of the file, and every further level makes it better", async () => {
  const { page, problems } = await newPage(browser);
  const [view] = views(CAMERAS, 100);
  const reference = join(folder.path, "levels");
  const drawn = levels.map((_, level) => {
    const out = join(reference, String(level));
    program("render", container, "--cameras", CAMERAS, "--frames", "0", "--size", "100x100", "--level-of-detail", String(level), "-o", out);
    return join(out, "r_0.s1.png");
  });
  const whole = await pixels(page, drawn[0]);
  server.sent = 0;
  server.gate = Math.floor(bytes.length / 20);
  await page.goto(server.page("gated.mipvog", bytes));
  await page.waitForFunction(() => window.__mipvog?.firstPicture);
  assert.ok(server.sent <= bytes.length / 20, `${server.sent} of ${bytes.length} bytes`);
  let finest = (await page.evaluate(() => window.__mipvog.field!.finest))!;
  assert.ok(finest > 0);
  let before = 0;
  for (; ; finest--) {
    // Only bytes of the levels so far were sent.
    assert.equal(server.sent, levels[finest].prefix_bytes);
    const picture = await capture(page, view);
    const likeness = psnr(picture, whole);
    assert.ok(likeness > before, `level ${finest}: ${likeness} dB after ${before} dB`);
    before = likeness;
    await page.evaluate((level) => (window.__mipvog.field!.fixedLevel = level), finest);
    const found = psnr(await capture(page, view), await pixels(page, drawn[finest]));
    assert.ok(found >= 40, `level ${finest}: ${found} dB`);
    await page.evaluate(() => (window.__mipvog.field!.fixedLevel = null));
    if (finest === 0) break;
    server.open(levels[finest - 1].prefix_bytes);
    await shows(page, finest - 1);
  }
  await ready(page);
  assert.equal(server.sent, bytes.length);
  assert.deepEqual(problems, []);
  await page.close();
});

night("every first part that ends at a level is shown, and says what is missing", async () => {
  server.gate = Infinity;
  const { page, problems } = await newPage(browser, { width: 800, height: 300 });
  for (const level of levels.keys()) {
    await page.goto(server.page("part.mipvog", bytes.subarray(0, levels[level].prefix_bytes)));
    await ready(page);
    assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), level);
    const facts = await page.evaluate(() => document.querySelector("#facts")!.textContent!);
    assert.equal(facts.includes("not in this part of the file"), level > 0, facts);
  }
  assert.deepEqual(problems, []);
  await page.close();
});

night("a server without ranges is asked once, and the panel says so", async () => {
  const { page, problems } = await newPage(browser, { width: 800, height: 300 });
  server.ranges = false;
  server.sent = 0;
  await page.goto(server.page("whole.mipvog", bytes));
  await ready(page);
  server.ranges = true;
  assert.equal(server.sent, bytes.length);
  assert.match(await page.evaluate(() => document.querySelector("#facts")!.textContent!), /the server offers no parts/);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a server that answers with less than was asked for is asked for the rest, whether it shows where parts end or not", async () => {
  const { page, problems } = await newPage(browser);
  const [view] = views(CAMERAS, 50);
  await page.goto(server.page("usual.mipvog", bytes));
  await ready(page);
  const whole = await capture(page, view);
  // A little more than the header, and less than the first request.
  for (const most of [200_000, 3000]) {
    server.most = most;
    server.sent = 0;
    await page.goto(server.page("short.mipvog", bytes));
    await ready(page);
    assert.equal(server.sent, bytes.length);
    assert.equal(await page.evaluate(() => window.__mipvog.field!.file!.transfer), "ranges");
    assert.equal(psnr(await capture(page, view), whole), Infinity);
  }
  // Of another host, which shows no Content-Range.
  server.headers = { "Access-Control-Allow-Origin": "*" };
  await page.goto(server.page("short.mipvog", bytes).replace("127.0.0.1", "localhost").replace("?file=", `?file=${server.origin}/`));
  await ready(page);
  [server.headers, server.most] = [{}, Infinity];
  assert.equal(psnr(await capture(page, view), whole), Infinity);
  assert.deepEqual(problems, []);
  await page.close();
});

night("a file that lies compressed on its server is read whole", async () => {
  const { page } = await newPage(browser);
  server.compressed = true;
  await page.goto(server.page("compressed.mipvog", bytes));
  await ready(page);
  server.compressed = false;
  assert.equal(await page.evaluate(() => window.__mipvog.field!.file!.transfer), "whole");
  await page.close();
});

test("a host that allows nobody is told as such", async () => {
  const { page } = await newPage(browser);
  await page.goto(server.page("foreign.mipvog", bytes).replace("127.0.0.1", "localhost").replace("?file=", `?file=${server.origin}/`));
  await page.waitForFunction(() => window.__mipvog?.error);
  assert.match(await page.locator("#error").innerText(), /foreign\.mipvog cannot be reached\.\s+.*Access-Control-Allow-Origin/);
  await page.close();
});

test("a broken file is told in words, and what came before stays", async () => {
  const { page, problems } = await newPage(browser);
  const damaged = (at: number) => {
    const copy = Buffer.from(bytes);
    copy[at] ^= 1;
    return copy;
  };
  const cases: [string, Buffer, RegExp, number | null][] = [
    ["level 0", damaged(bytes.length - 1000), /of level 0 at byte \d+ is damaged: its checksum/, 1],
    ["the coarsest level", damaged(levels[levels.length - 1].prefix_bytes - 100), /of level \d at byte \d+ is damaged/, null],
    ["the directory", damaged(100), /checksum of header and directory/, null],
    ["the metadata", damaged(64 + 64 * bytes.readUInt32LE(40) + 10), /META at byte \d+ is damaged/, null],
    ["a later version", Buffer.concat([bytes.subarray(0, 8), Buffer.from([2]), bytes.subarray(9)]), /version 2; this viewer knows version 1/, null],
    ["no container", Buffer.from("hello"), /no \.mipvog container/, null],
    ["nothing at all", Buffer.alloc(0), /empty|no \.mipvog container/, null],
    ["an end within a level", bytes.subarray(0, bytes.length - 64), /not where a level ends/, null],
    ["an end within the header", bytes.subarray(0, 30), /ends after 30 bytes/, null],
  ];
  for (const [name, content, message, finest] of cases) {
    await page.goto(server.page("broken.mipvog", content));
    await page.waitForFunction(() => window.__mipvog?.error);
    const error = page.locator("#error");
    assert.ok(await error.isVisible(), name);
    assert.match(await error.innerText(), message, name);
    if (finest !== null) await remains(page, finest);
  }
  await page.goto(`${server.origin}/?file=missing.mipvog`);
  await page.waitForFunction(() => window.__mipvog?.error);
  assert.match(await page.locator("#error").innerText(), /answers 404/);
  server.offer("missing.mipvog", bytes);
  await page.getByRole("button", { name: "Try again" }).click();
  await page.waitForFunction(() => window.__mipvog?.ready && !window.__mipvog.error);
  assert.ok(await page.locator("#error").isHidden());
  // The browser itself complains about the 404, nothing else does.
  assert.deepEqual(problems.filter((problem) => !problem.includes("404") && !problem.includes("416")), []);
  await page.close();
});

night("what fails after a picture is there is told beside it, and the picture is ready", async () => {
  const { page } = await newPage(browser, { width: 800, height: 500 });
  const damaged = Buffer.from(bytes);
  damaged[bytes.length - 1000] ^= 1;
  await page.goto(server.page("damaged.mipvog", damaged));
  await page.waitForFunction(() => window.__mipvog?.error && window.__mipvog.ready);
  const card = page.locator("#error");
  assert.match(await card.innerText(), /^Not all of this file could be loaded/);
  const middle = () => page.evaluate(() => document.elementFromPoint(innerWidth / 2, innerHeight / 2)!.id);
  assert.equal(await middle(), "picture");
  // A camera file that is not there is no fault of the file that is shown.
  await page.goto(`${server.page("sound.mipvog", bytes)}&cameras=missing.json`);
  await page.waitForFunction(() => window.__mipvog?.error && window.__mipvog.ready);
  assert.match(await card.innerText(), /^These views cannot be offered/);
  assert.equal(await middle(), "picture");
  assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), 0);
  await page.close();
});

/** Waits until a level is shown beside an error. */
async function remains(page: Page, level: number): Promise<void> {
  await page.waitForFunction((level) => window.__mipvog.field?.finest === level, level);
}

/** Takes the device and gives it back, until levels come again that nothing but this can bring. */
async function loseAndRegain(page: Page): Promise<void> {
  const restore = await loseDevice(page);
  await page.evaluate(() => {
    const counted = window as unknown as { changes: number };
    counted.changes = 0;
    window.__mipvog.field!.addEventListener("change", () => counted.changes++);
  });
  await restore();
  await page.waitForFunction(() => (window as unknown as { changes: number }).changes > 0 && !window.__mipvog.field!.waiting);
}

night("a device that is lost on the way gets back what had come, and the rest as it comes", async () => {
  const { page, problems } = await newPage(browser);
  server.gate = Math.floor(bytes.length / 20);
  await page.goto(server.page("lost.mipvog", bytes));
  await page.waitForFunction(() => window.__mipvog?.firstPicture);
  const finest = (await page.evaluate(() => window.__mipvog.field!.finest))!;
  assert.ok(finest > 0);
  await page.evaluate(() => {
    const { field } = window.__mipvog;
    field!.finished.then(() => ((window as unknown as { finished: boolean }).finished = true));
  });
  const [view] = views(CAMERAS, 50);
  const before = await capture(page, view);
  await loseAndRegain(page);
  await shows(page, finest);
  assert.equal(psnr(await capture(page, view), before), Infinity);
  // Levels that came again are no end of loading.
  assert.equal(await page.evaluate(() => "finished" in window), false);
  assert.ok(await page.locator("#progress").isVisible());
  server.open(Infinity);
  await ready(page);
  assert.equal(await page.evaluate(() => "finished" in window), true);
  // What came before an error comes again, too.
  const damaged = Buffer.from(bytes);
  damaged[bytes.length - 1000] ^= 1;
  await page.goto(server.page("damaged.mipvog", damaged));
  await page.waitForFunction(() => window.__mipvog?.error);
  await remains(page, 1);
  const kept = await capture(page, view);
  await loseAndRegain(page);
  await remains(page, 1);
  assert.equal(psnr(await capture(page, view), kept), Infinity);
  assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
  await page.close();
});

/** A page on so many cores, whose workers of these numbers, in the order in which they are started, are not to be had. */
async function withWorkers(cores: number, missing: number[] = []): Promise<{ page: Page; problems: string[] }> {
  const made = await newPage(browser);
  await made.page.addInitScript(([cores, missing]) => {
    const Own = Worker;
    const working = ((window as unknown as { working: Set<Worker> }).working = new Set());
    let count = 0;
    window.Worker = class extends Own {
      constructor(address: string | URL, options?: WorkerOptions) {
        super(missing.includes(++count) ? "missing.js" : address, options);
        working.add(this);
      }

      override terminate(): void {
        super.terminate();
        working.delete(this);
      }
    };
    // As many helpers as this on every machine.
    Object.defineProperty(navigator, "hardwareConcurrency", { value: cores });
  }, [cores, missing] as const);
  return made;
}

night("workers that help are missed by nobody, and without the one that reads nothing is waited for", async () => {
  const large = join(folder.path, "large.mipvog");
  program("bake", join(LEGO, "fine_last.tar"), "--stepsize", "0.5", "--bits", "12", "--block-size", "4", "-o", large);
  const content = readFileSync(large);
  assert.ok(content.length > 1 << 20, "large enough for helpers");
  const [view] = views(CAMERAS, 50);
  const pictures = [];
  // The first worker asks the device, the second one reads.
  for (const missing of [[], [3], [3, 4]]) {
    const { page, problems } = await withWorkers(2, missing);
    await page.goto(server.page("large.mipvog", content));
    await ready(page);
    assert.equal(await page.evaluate(() => window.__mipvog.field!.finest), 0);
    pictures.push(await capture(page, view));
    assert.deepEqual(problems.filter((problem) => !problem.includes("404")), []);
    await page.close();
  }
  assert.ok(new Set(pictures[0]).size > 50, "something is to be seen");
  for (const picture of pictures) assert.equal(psnr(picture, pictures[0]), Infinity);
  const { page } = await withWorkers(2, [2]);
  await page.goto(server.page("large.mipvog", content));
  await page.waitForFunction(() => window.__mipvog?.error);
  assert.match(await page.locator("#error").innerText(), /decoder could not be started/);
  await page.close();
});

night("pictures of every level are the program's, however many workers help", async () => {
  const large = join(folder.path, "small_blocks.mipvog");
  // With 4 and with 16 helpers, shares of level 1 end at faces of the grid.
  program("bake", join(LEGO, "fine_last.tar"), "--stepsize", "0.5", "--near", "2", "--far", "6", "--bits", "12", "--block-size", "2", "-o", large);
  const content = readFileSync(large);
  const [view] = views(CAMERAS, 50);
  const finest = [0, 1, 2];
  const reference = finest.map((level) => {
    const out = join(folder.path, `small_blocks.${level}`);
    program("render", large, "--cameras", CAMERAS, "--frames", "0", "--size", "50x50", "--level-of-detail", String(level), "-o", out);
    return join(out, "r_0.s1.png");
  });
  const alone: number[][] = [];
  for (const cores of [1, 3, 4, 8, 16]) {
    const { page, problems } = await withWorkers(cores);
    await page.goto(server.page("small_blocks.mipvog", content));
    await ready(page);
    // The one that reads may have to decode again; the others have ended.
    await page.waitForFunction(() => (window as unknown as { working: Set<Worker> }).working.size === 1);
    for (const level of finest) {
      await page.evaluate((level) => (window.__mipvog.field!.fixedLevel = level), level);
      const picture = await capture(page, view);
      const found = psnr(picture, await pixels(page, reference[level]));
      assert.ok(found >= 50, `level ${level}, ${cores} cores: ${found} dB`);
      assert.deepEqual(picture, (alone[level] ??= picture), `level ${level}, ${cores} cores`);
    }
    if (cores === 4) {
      // Without helpers, too, all comes again.
      await loseAndRegain(page);
      await ready(page);
      await page.evaluate(() => (window.__mipvog.field!.fixedLevel = 1));
      assert.deepEqual(await capture(page, view), alone[1]);
    }
    assert.deepEqual(problems.filter((problem) => !/context lost/i.test(problem)), []);
    await page.close();
  }
});
