/** The page: opens what the address names or what is dropped, and says how it goes. */

import { Color, Matrix4, SRGBColorSpace, Vector3 } from "three";
import { deviceLimits } from "../src/device.js";
import { REMEDY } from "../src/errors.js";
import { FieldError, type RadianceField, type Statistics } from "../src/index.js";
import { type Opened, openAddress, openFile, type OpenOptions, release, standpoint, visibleBox } from "../src/stage/opened.js";
import { Stage } from "../src/stage/stage.js";
import { viewpointText } from "../src/stage/viewpoint.js";
import { ownFile, useOwnWorker } from "./embedded.js";
import { offerLevels, page, showError, showFacts, showName } from "./panel.js";
import { bindMeasure } from "./measure.js";
import { bindTools, setRotation, showView } from "./tools.js";
import { addressedView, fetchCameras, firstView, forgetView, goTo, goToChosen, nameView, openCameras } from "./views.js";

/** What scripts may ask the page; the viewer's own tests do. */
interface Hook {
  /** Whether everything that will come is loaded and drawn. */
  readonly ready: boolean;
  readonly error: string | null;
  /** Bytes that had arrived when the first picture was drawn. */
  readonly firstPicture: number | null;
  readonly field: RadianceField | null;
  /** Undefined until the device is started. */
  readonly stage: Stage;
  /** Pixels of a picture; `toWorld` is a camera's matrix in the field's axes, row by row. */
  capture(view: { width: number; height: number; toWorld: number[][]; focal: number; seesAll?: boolean }): number[];
  statistics(skips: boolean): Statistics | null;
}

declare global {
  interface Window {
    __mipvog: Hook;
  }
}

/** After this long without a new picture, what the last one took is counted. */
const COUNT_MS = 250;
/** Windows from this width on start with an open panel. */
const WIDE = 1000;

let stage: Stage;
let measuring: ReturnType<typeof bindMeasure>;
/** Resolves once there is a stage. */
let started: Promise<void>;
let opened: Opened | null = null;
/** The second file of a comparison. */
let other: Opened | null = null;
let error: FieldError | null = null;
let heading = "";
/** Opens once more what was opened last. */
let again: (() => void) | null = null;
let loading = false;
let firstPicture: number | null = null;
let statistics: Statistics | null = null;
let number = 0;
let counting = 0;
/** The view that the page chose. */
let framed = "";
/** How files are opened. */
const options: OpenOptions = {};
/** What the next chosen file is for. */
let purpose: (file: File) => Promise<void> = (file) => show(() => openFile(file, options));

const field = () => opened?.fields[0] ?? null;
const fields = () => [...(opened?.fields ?? []), ...(other?.fields ?? [])];

/** What an error is about. */
const HEADINGS = {
  file: "This file cannot be shown.",
  rest: "Not all of this file could be loaded. What came is shown.",
  without: "This file is shown without some of its parts.",
  views: "These views cannot be offered.",
  page: "Nothing can be drawn here.",
  device: "The graphics device was taken away.",
} as const;

function fail(cause: unknown, about: keyof typeof HEADINGS = "file"): void {
  error = cause instanceof FieldError ? cause : new FieldError(cause instanceof Error ? cause.message : String(cause));
  // What is on its way goes on coming.
  if (about !== "views" && about !== "without") {
    loading = false;
    page.progress.hidden = true;
  }
  page.hint.hidden = true;
  heading = HEADINGS[about];
  showError(error, heading, about === "file" || about === "rest" ? again : null);
}

const failViews = (cause: unknown) => fail(cause, "views");

/** Opens a file as far as it can be drawn; null where another one was asked for meanwhile. */
async function begin(open: () => Opened | Promise<Opened>): Promise<Opened | null> {
  const own = ++number;
  error = null;
  showError(null);
  page.hint.hidden = true;
  page.progress.hidden = false;
  page.progress.removeAttribute("value");
  loading = true;
  let made: Opened | null = null;
  try {
    await started;
    made = await open();
    await Promise.all(made.fields.map((field) => field.opened));
    await stage.prepare(made.object);
    if (own === number) return made;
  } catch (cause) {
    // What is shown stays.
    if (own === number) fail(cause);
  }
  if (made) release(made);
  return null;
}

/** Waits for the rest of what is shown. */
async function finish(made: Opened): Promise<void> {
  const own = number;
  made.fields.forEach((field) => follow(field, made));
  try {
    await Promise.all(made.fields.map((field) => field.finished));
    if (own !== number) return;
    loading = false;
    page.progress.hidden = true;
    stage.redraw();
  } catch (cause) {
    if (own === number) fail(cause, made.fields.every(({ file }) => file) ? "rest" : "file");
  }
}

/** Shows what `open` gives in place of what is shown, under another name where there is one. */
async function show(open: () => Opened | Promise<Opened>, name?: string | null): Promise<void> {
  again = () => void show(open, name);
  const isFirst = opened === null;
  const made = await begin(open);
  if (!made) return;
  close();
  if (!isFirst) forgetView();
  opened = { ...made, name: name || made.name };
  stage.scene.add(made.object);
  measuring.forget();
  showName(opened.name);
  offerLevels(field());
  paint(askedGround());
  frame();
  if (made.lacks) fail(made.lacks, "without");
  await finish(made);
}

/** Shows a second file beside the first. */
async function compare(open: () => Opened | Promise<Opened>): Promise<void> {
  again = () => void compare(open);
  const made = await begin(open);
  if (!made) return;
  // Nothing that it could stand beside.
  if (!opened) return release(made);
  if (other) remove(other);
  other = made;
  stage.scene.add(made.object);
  page.split.hidden = page.line.hidden = false;
  [opened.name, made.name].forEach((name, side) => (page.sides[side].textContent = name));
  showChoices();
  divide();
  if (made.lacks) fail(made.lacks, "without");
  await finish(made);
}

function divide(): void {
  const at = Number(page.at.value) / 1000;
  page.line.style.left = `${100 * at}%`;
  stage.painter.split = opened && other && { left: opened.object, right: other.object, at };
  stage.painter.move();
}

function remove(made: Opened): void {
  stage.scene.remove(made.object);
  release(made);
}

function close(): void {
  for (const made of [opened, other]) if (made) remove(made);
  [opened, other, firstPicture, statistics, stage.painter.split] = [null, null, null, null, null];
  page.split.hidden = page.line.hidden = page.legend.hidden = true;
  page.colors.checked = false;
}

/** The whole subject, or of a world what its first camera sees; or the view that the address names. */
function frame(): void {
  if (!opened) return;
  const inside = standpoint(opened);
  stage.show(visibleBox(opened), inside);
  const first = inside && firstView(field());
  if (first) stage.viewpoint = first;
  framed = viewpointText(stage.viewpoint);
  const view = addressedView();
  if (view) stage.viewpoint = view;
  showView(stage);
}

/** The ground that the address asks for; null without one, or where no color has this name. */
function askedGround(): string | null {
  const color = new URLSearchParams(location.search).get("background");
  return color && CSS.supports("color", color) ? color : null;
}

/** The ground behind the field: a color, or null for the one that it was trained on. */
function paint(color: string | null): void {
  const trained = field()?.metadata?.background ?? [1, 1, 1];
  const ground = color ? new Color(color) : new Color().setRGB(...trained, SRGBColorSpace);
  page.background.value = `#${ground.getHexString()}`;
  stage.setBackground(ground);
}

function follow(shown: RadianceField, made: Opened): void {
  let isFramed = shown.finest !== null || made === other;
  const stood = standpoint(made) ?? new Vector3();
  shown.addEventListener("change", () => {
    // What the first level shows is known now; where a world is free, a finer one may tell.
    const place = standpoint(made);
    if ((!isFramed || (place && made !== other && !place.equals(stood))) && viewpointText(stage.viewpoint) === framed) frame();
    isFramed = true;
    if (place) stood.copy(place);
  });
  shown.addEventListener("progress", ({ loaded, total }) => {
    page.progress.value = total > 0 ? loaded / total : 0;
  });
  shown.addEventListener("failed", ({ error }) => fail(error, shown.file ? "rest" : "file"));
}

/** After each picture. */
function drawn(): void {
  const shown = field();
  if (shown && shown.finest !== null) {
    firstPicture ??= shown.arrived;
    page.poster.hidden = true;
    nameView(stage, framed);
    // Counting draws a small picture of its own, so it waits until nothing moves, and for somebody to look.
    clearTimeout(counting);
    counting = window.setTimeout(() => {
      if (!page.numbers.open || shown !== field() || shown.waiting || stage.renderer.getContext().isContextLost()) return;
      statistics = stage.count(shown, true);
      tell();
    }, COUNT_MS);
  }
  tell();
}

function tell(): void {
  showFacts(opened?.name ?? "none", field(), stage.painter.frameTime, statistics);
}

/** Shows all fields at the chosen level, in the chosen colours. */
function showChoices(): void {
  for (const shown of fields()) {
    shown.fixedLevel = page.level.value === "" ? null : Number(page.level.value);
    shown.showLevels = page.colors.checked;
  }
  stage.redraw();
}

/** Asks for a file, for one purpose. */
function ask(accept: string, then: (file: File) => Promise<void>): void {
  purpose = then;
  page.chooser.accept = accept;
  page.chooser.click();
}

/** A file that was dropped: a camera file, or something to show. */
async function take(file: File): Promise<void> {
  if (!/\.json$/i.test(file.name)) return show(() => openFile(file, options));
  if (!opened) return failViews(new FieldError(`${file.name} is a camera file, and nothing is open yet.`, REMEDY.json));
  await openCameras(file).catch(failViews);
}

/** Takes files from the first moment on: a browser leaves the page for one that nobody takes. */
function listenForFiles(): void {
  page.openers.forEach((button) => button.addEventListener("click", () => ask(".mipvog,.glb", (file) => show(() => openFile(file, options)))));
  page.beside.addEventListener("click", () => ask(".mipvog,.glb", (file) => compare(() => openFile(file, options))));
  page.cameras.addEventListener("click", () => ask(".json", (file) => openCameras(file).catch(failViews)));
  page.chooser.addEventListener("change", () => {
    const file = page.chooser.files?.[0];
    if (file) void purpose(file);
    page.chooser.value = "";
  });
  const over = (dropping: boolean) => page.main.classList.toggle("dropping", dropping);
  page.main.addEventListener("dragover", (event) => {
    event.preventDefault();
    over(true);
  });
  page.main.addEventListener("dragleave", () => over(false));
  page.main.addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    const file = event.dataTransfer?.files[0];
    if (file) void take(file);
  });
}

function listen(): void {
  page.level.addEventListener("change", showChoices);
  page.colors.addEventListener("change", () => {
    page.legend.hidden = !page.colors.checked;
    showChoices();
  });
  page.fov.addEventListener("input", () => (stage.fov = Number(page.fov.value)));
  page.background.addEventListener("input", () => paint(page.background.value));
  page.trained.addEventListener("click", () => paint(null));
  page.views.addEventListener("change", () => goToChosen(stage, field()));
  // A link to another view of this page.
  addEventListener("hashchange", () => {
    const view = addressedView();
    if (opened && view) goTo(stage, view);
  });
  page.at.addEventListener("input", divide);
  page.numbers.addEventListener("toggle", drawn);
  page.canvas.addEventListener("dblclick", ({ offsetX, offsetY }) => {
    const shown = field();
    if (shown) stage.focus(shown, offsetX, offsetY);
  });
  page.canvas.addEventListener("webglcontextlost", () => showError({ message: REMEDY.returned }, HEADINGS.device));
  page.canvas.addEventListener("webglcontextrestored", () => showError(error, heading, again));
}

async function start(): Promise<void> {
  // The stage's context would hold the page up where it is the one that starts the device.
  await deviceLimits();
  stage = new Stage(page.canvas);
  stage.painter.drawn = drawn;
  listen();
  const name = () => opened?.name ?? "picture";
  measuring = bindMeasure(stage, field, name);
  bindTools(stage, name, () => measuring.toggle());
  if (new URLSearchParams(location.search).has("autorotate") && !matchMedia("(prefers-reduced-motion: reduce)").matches) setRotation(stage, true);
  offerLevels(null);
  page.panel.open = innerWidth >= WIDE;
}

window.__mipvog = {
  get ready() {
    return !loading && opened !== null && stage.settled && fields().every((field) => field.finest !== null && !field.waiting);
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
  capture({ width, height, toWorld, focal, seesAll }) {
    const shown = field();
    if (!shown) return [];
    shown.updateWorldMatrix(true, false);
    const camera = new Matrix4().fromArray(toWorld.flat()).transpose().premultiply(shown.matrixWorld);
    shown.keepsRange = !seesAll;
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
  const own = ownFile();
  const asked = new URLSearchParams(location.search);
  // For frames in other pages.
  page.main.classList.toggle("bare", asked.get("ui") === "0");
  const poster = asked.get("poster");
  if (poster) [page.poster.src, page.poster.hidden] = [poster, false];
  useOwnWorker();
  listenForFiles();
  await (started = start());
  const maxBytes = Number(asked.get("max-bytes"));
  if (maxBytes > 0) options.maxBytes = maxBytes;
  const [address, beside, cameras] = [asked.get("file"), asked.get("compare"), asked.get("cameras")];
  if (cameras) {
    const startThere = () => opened && standpoint(opened) && viewpointText(stage.viewpoint) === framed && frame();
    void fetchCameras(cameras).then(startThere).catch(failViews);
  }
  if (address) void show(() => openAddress(address, options), asked.get("name")).then(() => (beside ? compare(() => openAddress(beside, options)) : undefined));
  else if (own) void show(() => ("bytes" in own ? openFile(new File([own.bytes], own.name), options) : openAddress(own.address, options)));
} catch (cause) {
  fail(cause, "page");
}
