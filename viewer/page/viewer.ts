/** The page: opens what the address names or what is dropped, and says how it goes. */

import { Color, Matrix4, SRGBColorSpace } from "three";
import { FieldError, type RadianceField, type Statistics } from "../src/index.js";
import { type Opened, openAddress, release, visibleBox } from "../src/stage/opened.js";
import { openFile } from "./open.js";
import { offerLevels, page, showError, showFacts } from "./panel.js";
import { Stage } from "../src/stage/stage.js";

/** What scripts may ask the page; the viewer's own tests do. */
interface Hook {
  /** Whether everything is loaded and drawn. */
  readonly ready: boolean;
  readonly error: string | null;
  /** Bytes that had arrived when the first picture was drawn. */
  readonly firstPicture: number | null;
  readonly field: RadianceField | null;
  readonly stage: Stage;
  /** Pixels of a picture; `toWorld` is a camera's matrix in the field's axes, row by row. */
  capture(view: { width: number; height: number; toWorld: number[][]; focal: number }): number[];
  statistics(skips: boolean): Statistics | null;
}

declare global {
  interface Window {
    __mipvog: Hook;
  }
}

/** After this long without a new picture, what the last one took is counted. */
const COUNT_MS = 250;

let stage: Stage;
let opened: Opened | null = null;
let error: FieldError | null = null;
let loading = false;
let firstPicture: number | null = null;
let statistics: Statistics | null = null;
let number = 0;
let counting = 0;

const field = () => opened?.fields[0] ?? null;

function fail(cause: unknown): void {
  error = cause instanceof FieldError ? cause : new FieldError(cause instanceof Error ? cause.message : String(cause));
  loading = false;
  page.progress.hidden = true;
  page.hint.hidden = true;
  showError(error);
}

/** Shows what `open` gives in place of what is shown. */
async function show(open: () => Opened | Promise<Opened>): Promise<void> {
  const own = ++number;
  close();
  page.hint.hidden = true;
  page.progress.hidden = false;
  page.progress.removeAttribute("value");
  loading = true;
  try {
    const made = await open();
    if (own !== number) {
      release(made);
      return;
    }
    opened = made;
    stage.scene.add(made.object);
    made.fields.forEach(follow);
    await Promise.all(made.fields.map((field) => field.opened));
    if (own !== number) return;
    offerLevels(field());
    const background = field()?.metadata?.background;
    if (background) stage.setBackground(new Color().setRGB(...background, SRGBColorSpace));
    stage.lookAt(visibleBox(made));
    await Promise.all(made.fields.map((field) => field.finished));
    if (own !== number) return;
    loading = false;
    page.progress.hidden = true;
    stage.redraw();
  } catch (cause) {
    if (own === number) fail(cause);
  }
}

function close(): void {
  if (opened) {
    stage.scene.remove(opened.object);
    release(opened);
  }
  [opened, error, firstPicture, statistics] = [null, null, null, null];
  offerLevels(null);
  page.colors.checked = false;
  showError(null);
  stage.redraw();
}

function follow(shown: RadianceField): void {
  shown.addEventListener("change", () => {
    if (shown.finest === null && opened) stage.lookAt(visibleBox(opened));
    stage.redraw();
  });
  shown.addEventListener("progress", ({ arrived }) => {
    page.progress.value = shown.file ? arrived / shown.file.fileBytes : 0;
  });
  shown.addEventListener("failed", ({ error }) => fail(error));
}

/** After each picture. */
function drawn(): void {
  const shown = field();
  if (shown && shown.finest !== null) {
    firstPicture ??= shown.arrived;
    // Counting draws a small picture of its own, so it waits until nothing moves.
    clearTimeout(counting);
    counting = window.setTimeout(() => {
      if (shown !== field() || shown.waiting || stage.renderer.getContext().isContextLost()) return;
      statistics = stage.count(shown, true);
      tell();
    }, COUNT_MS);
  }
  tell();
}

function tell(): void {
  showFacts(opened?.name ?? "none", field(), stage.painter.frameTime, statistics);
}

function listen(): void {
  page.level.addEventListener("change", () => {
    opened?.fields.forEach((field) => (field.fixedLevel = page.level.value === "" ? null : Number(page.level.value)));
    stage.redraw();
  });
  page.colors.addEventListener("change", () => {
    opened?.fields.forEach((field) => (field.showLevels = page.colors.checked));
    stage.redraw();
  });
  page.canvas.addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() === "l" && !event.ctrlKey && !event.metaKey) page.colors.click();
  });
  page.openers.forEach((button) => button.addEventListener("click", () => page.chooser.click()));
  page.chooser.addEventListener("change", () => {
    const file = page.chooser.files?.[0];
    page.chooser.value = "";
    if (file) void show(() => openFile(file));
  });
  const main = page.canvas.parentElement!;
  const over = (dropping: boolean) => main.classList.toggle("dropping", dropping);
  main.addEventListener("dragover", (event) => {
    event.preventDefault();
    over(true);
  });
  main.addEventListener("dragleave", () => over(false));
  main.addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    const file = event.dataTransfer?.files[0];
    if (file) void show(() => openFile(file));
  });
  page.canvas.addEventListener("webglcontextlost", () => showError({ message: "The picture comes back when the browser returns it." }, "The graphics device was taken away."));
  page.canvas.addEventListener("webglcontextrestored", () => showError(error));
}

window.__mipvog = {
  get ready() {
    return !loading && opened !== null && error === null && stage.settled && opened.fields.every((field) => field.finest !== null && !field.waiting);
  },
  get error() {
    return error && `${error.message} ${error.remedy}`;
  },
  get firstPicture() {
    return firstPicture;
  },
  get field() {
    return field();
  },
  get stage() {
    return stage;
  },
  capture({ width, height, toWorld, focal }) {
    const shown = field();
    if (!shown) return [];
    shown.updateWorldMatrix(true, false);
    const camera = new Matrix4().fromArray(toWorld.flat()).transpose().premultiply(shown.matrixWorld);
    shown.keepsRange = true;
    const pixels = Array.from(stage.capture(width, height, camera.toArray(), focal));
    shown.keepsRange = false;
    return pixels;
  },
  statistics(skips) {
    const shown = field();
    return shown && stage.count(shown, skips);
  },
};

try {
  stage = new Stage(page.canvas);
  stage.painter.drawn = drawn;
  listen();
  offerLevels(null);
  if (innerWidth < 560) page.panel.open = false;
  const address = new URLSearchParams(location.search).get("file");
  if (address) void show(() => openAddress(address));
} catch (cause) {
  fail(new FieldError(`This browser cannot draw with WebGL 2: ${cause instanceof Error ? cause.message : String(cause)}.`, "Use a current browser, or switch hardware acceleration on."));
}
