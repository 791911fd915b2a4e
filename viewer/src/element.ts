/** `<mipvog-viewer src="scene.mipvog">`: a field in any page, without scripting. */

import { Color, SRGBColorSpace, Vector3 } from "three";
import { deviceLimits } from "./device.js";
import { FieldError } from "./errors.js";
import type { RadianceField } from "./three/field.js";
import { type Opened, openAddress, release, standpoint, visibleBox } from "./stage/opened.js";
import { Stage } from "./stage/stage.js";
import { readViewpoint, type Viewpoint, viewpointText } from "./stage/viewpoint.js";

const STYLE = `
:host { display: block; position: relative; width: 100%; aspect-ratio: 3 / 2; overflow: hidden; }
:host([hidden]) { display: none; }
canvas, img { position: absolute; inset: 0; width: 100%; height: 100%; }
img { object-fit: cover; pointer-events: none; }
[hidden] { display: none; }
p { position: absolute; inset: auto 0 0; margin: 0; padding: 0.5em; color: #fff; background: #000c; }
p button { font: inherit; }
::slotted([data-position]) { position: absolute; left: 0; top: 0; }
`;

/** The base class of the element. Servers, which render pages without showing them, have none. */
const Base = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;
/** The text alternative of pictures without `alt`. */
const UNNAMED = "A radiance field";
/** Attributes that are properties of the same value; boolean attributes; all others. */
const TEXTS = ["src", "background", "alt", "poster"] as const;
const ATTRIBUTES = [...TEXTS, "camera", "auto-rotate", "disable-zoom", "disable-pan", "distance-limits", "elevation-limits", "touch-action", "max-bytes"] as const;

/** Maximum number of stages. Browsers limit the WebGL contexts of a page, and other content needs some. */
const MOST_STAGES = 8;
/** Elements with `loading="lazy"`, and those that gave up their stage, start when they are this close to the window. */
const NEAR = "200px";
/** Elements with a stage, the most recently used last; and elements that wait for a stage. */
const live: MipvogViewer[] = [];
const waiting = new Set<MipvogViewer>();

/**
 * Attributes, of which the first four are also properties: `src`, the address of a `.mipvog`, `.glb` or `.gltf`;
 * `background`, a CSS color instead of the background of training; `alt`, the text alternative; `poster`, a picture to
 * show until the field is drawn. `camera`: position, target and field of view, seven numbers with commas as in the
 * page's address; `auto-rotate`; `disable-zoom`; `disable-pan`; `distance-limits` from the target and
 * `elevation-limits` in degrees, two numbers each; `touch-action` as in CSS, by default `pan-y`; `loading="lazy"`;
 * `max-bytes` of textures. Children with `data-position`, three numbers, are overlaid at this position of the scene.
 * Events: `load` when the first level can be drawn, and `error`, whose `detail` is a `FieldError`. The element also
 * displays errors.
 */
export class MipvogViewer extends Base {
  static readonly observedAttributes: readonly string[] = ATTRIBUTES;
  /** Camera, renderer and scene; null until the device is started, and while the element is not in a page. */
  stage: Stage | null = null;
  private opened: Opened | null = null;
  private canvas = document.createElement("canvas");
  private readonly image = document.createElement("img");
  private readonly message = document.createElement("p");
  private readonly words = document.createElement("span");
  /** The element's last picture, while its stage belongs to another element. */
  private still: HTMLCanvasElement | null = null;
  private kept: Viewpoint | null = null;
  private isNear = true;
  private watch: IntersectionObserver | null = null;
  /** Whether the stage is being created. */
  private isStarting = false;
  private number = 0;
  /** The last reported failure: the same failure can arrive in several ways. */
  private failure: unknown = null;
  /** The view that the element chose itself. */
  private framed = "";

  constructor() {
    super();
    // Allowed by a content security policy without inline styles.
    const style = new CSSStyleSheet();
    style.replaceSync(STYLE);
    this.message.setAttribute("role", "alert");
    this.message.hidden = this.image.hidden = true;
    this.image.alt = "";
    const again = document.createElement("button");
    [again.type, again.textContent] = ["button", "Try again"];
    again.addEventListener("click", () => void (this.stage ? this.load() : this.start()));
    this.message.append(this.words, " ", again);
    const root = this.attachShadow({ mode: "open" });
    root.adoptedStyleSheets = [style];
    root.append(this.canvas, this.image, document.createElement("slot"), this.message);
    this.dress();
    // The page scrolls, unless a hand is on the picture.
    root.addEventListener("wheel", (event) => {
      const { ctrlKey, metaKey } = event as WheelEvent;
      if (this.hasAttribute("disable-zoom") || !(ctrlKey || metaKey || root.activeElement === this.canvas)) event.stopPropagation();
    }, { capture: true });
    root.addEventListener("pointerdown", () => this.use(), { capture: true });
  }

  /** Makes the canvas accessible to screen readers and the keyboard. */
  private dress(): void {
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.ariaLabel = this.alt || UNNAMED;
  }

  /** The fields shown. */
  get fields(): RadianceField[] {
    return this.opened?.fields ?? [];
  }

  get src(): string {
    return this.getAttribute("src") ?? "";
  }

  set src(address: string | null) {
    this.reflect("src", address);
  }

  get background(): string {
    return this.getAttribute("background") ?? "";
  }

  set background(color: string | null) {
    this.reflect("background", color);
  }

  get alt(): string {
    return this.getAttribute("alt") ?? "";
  }

  set alt(words: string | null) {
    this.reflect("alt", words);
  }

  get poster(): string {
    return this.getAttribute("poster") ?? "";
  }

  set poster(address: string | null) {
    this.reflect("poster", address);
  }

  private reflect(name: (typeof TEXTS)[number], value: string | null | undefined): void {
    if (value === null || value === undefined) this.removeAttribute(name);
    else this.setAttribute(name, value);
  }

  connectedCallback(): void {
    for (const name of TEXTS) {
      // What was set before the element was known hides the property.
      if (!Object.hasOwn(this, name)) continue;
      const value = this[name];
      delete (this as Partial<Record<typeof name, string>>)[name];
      this[name] = value;
    }
    this.isNear = this.getAttribute("loading") !== "lazy";
    this.watch = new IntersectionObserver((entries) => {
      this.isNear = entries.at(-1)!.isIntersecting;
      if (this.isNear) void this.start();
    }, { rootMargin: NEAR });
    this.watch.observe(this);
    this.showPoster();
    if (this.isNear) void this.start();
  }

  /**
   * Creates the stage after the device is started: otherwise, its context would start the device and block the page.
   */
  private async start(): Promise<void> {
    if (this.stage || this.isStarting) return;
    this.isStarting = true;
    try {
      await deviceLimits();
      // Meanwhile it may have left the page, or left it and come back.
      if (!this.isConnected || this.stage || !makeRoom(this)) return;
      if (this.still) this.renew();
      this.stage = new Stage(this.canvas);
      live.push(this);
      this.stage.framed = () => this.place();
      this.stage.rested = () => serveWaiting();
      this.arrange();
      void this.load();
    } catch (error) {
      this.fail(error);
    } finally {
      this.isStarting = false;
    }
  }

  /** Whether the element can give up its stage without a visible change: everything is loaded and drawn. */
  get isAtRest(): boolean {
    const isLoaded = this.failure !== null || !this.src || this.stage?.hasDrawn === true;
    return isLoaded && this.stage !== null && this.stage.settled && !this.hasAttribute("auto-rotate") && this.fields.every((field) => field.finest === field.file?.plan.finest && !field.waiting && !field.decoding);
  }

  get isInView(): boolean {
    return this.isNear;
  }

  /** Gives the stage to another element, and keeps showing the last picture. */
  giveUp(): void {
    if (!this.stage) return;
    const still = document.createElement("canvas");
    [still.width, still.height] = [this.canvas.width, this.canvas.height];
    still.getContext("2d")!.drawImage(this.canvas, 0, 0);
    still.style.background = this.canvas.style.background;
    if (viewpointText(this.stage.viewpoint) !== this.framed) this.kept = this.stage.viewpoint;
    this.end();
    this.canvas.replaceWith(still);
    this.still = this.canvas = still;
    this.dress();
  }

  /** Replaces the canvas, which keeps its context for good. */
  private renew(): void {
    const canvas = document.createElement("canvas");
    this.still!.after(canvas);
    this.canvas = canvas;
    this.dress();
  }

  /** Called when a stage is available again. */
  resume(): void {
    if (this.isNear) void this.start();
  }

  /** Marks the element as recently used, so that it gives up its stage last. */
  private use(): void {
    const at = live.indexOf(this);
    if (at >= 0) live.push(...live.splice(at, 1));
    else void this.start();
  }

  private end(): void {
    this.close();
    this.stage?.dispose();
    this.stage = null;
    const at = live.indexOf(this);
    if (at >= 0) live.splice(at, 1);
  }

  disconnectedCallback(): void {
    this.watch?.disconnect();
    waiting.delete(this);
    if (this.stage) {
      // The context is of no use to anybody else, and there are few.
      const canvas = document.createElement("canvas");
      this.end();
      this.canvas.replaceWith(canvas);
      this.canvas = canvas;
      this.dress();
    }
    serveWaiting();
  }

  attributeChangedCallback(name: string): void {
    if (name === "alt") this.canvas.ariaLabel = this.alt || UNNAMED;
    else if (name === "poster") this.showPoster();
    if (name === "src") this.kept = null;
    if (!this.stage) return;
    if (name === "background") this.paint();
    else if (name === "src" || name === "max-bytes") void this.load();
    else this.arrange();
  }

  /** Two numbers of an attribute; null if it has anything else. */
  private limits(name: string): [number, number] | null {
    const values = (this.getAttribute(name) ?? "").trim().split(/[\s,]+/).map(Number);
    return values.length === 2 && values.every(Number.isFinite) && values[0] <= values[1] ? [values[0], values[1]] : null;
  }

  /** Applies the attributes to the camera's controls. */
  private arrange(): void {
    const { stage } = this;
    if (!stage) return;
    stage.controls.autoRotate = this.hasAttribute("auto-rotate") && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    stage.controls.enableZoom = !this.hasAttribute("disable-zoom");
    stage.controls.enablePan = !this.hasAttribute("disable-pan");
    stage.limits = { distance: this.limits("distance-limits"), elevation: this.limits("elevation-limits") };
    this.canvas.style.touchAction = this.getAttribute("touch-action") ?? "pan-y";
    const view = readViewpoint(this.getAttribute("camera") ?? "");
    if (view && this.opened) stage.viewpoint = view;
  }

  private showPoster(): void {
    if (this.poster) this.image.src = this.poster;
    this.image.hidden = !this.poster || this.stage?.hasDrawn === true;
  }

  /** Places children at their positions. */
  private place(): void {
    const { stage } = this;
    if (!stage) return;
    if (stage.hasDrawn && !this.image.hidden) this.image.hidden = true;
    if (stage.hasDrawn && this.still && this.still !== this.canvas) {
      this.still.remove();
      this.still = null;
    }
    for (const child of this.querySelectorAll<HTMLElement>(":scope > [data-position]")) {
      const values = child.dataset.position!.trim().split(/[\s,]+/).map(Number);
      const at = values.length === 3 && values.every(Number.isFinite) ? stage.project(new Vector3(...values)) : null;
      child.style.visibility = at ? "" : "hidden";
      if (at) child.style.transform = `translate(${at[0]}px, ${at[1]}px) translate(-50%, -50%)`;
    }
  }

  private async load(): Promise<void> {
    this.close();
    const own = this.number;
    const address = this.getAttribute("src");
    if (!address) return;
    let made: Opened | null = null;
    try {
      const maxBytes = Number(this.getAttribute("max-bytes"));
      made = await openAddress(new URL(address, document.baseURI).href, maxBytes > 0 ? { maxBytes } : {});
      if (own !== this.number || !this.stage) return release(made);
      const shown = made;
      this.opened = shown;
      for (const field of shown.fields) {
        let isFramed = false;
        field.addEventListener("change", () => {
          // Where something is to be seen is known from a field's first level on; where a world is free, from a finer one.
          if ((!isFramed || field.isWorld) && this.stage && viewpointText(this.stage.viewpoint) === this.framed) this.frame(this.stage, shown);
          isFramed ||= field.finest !== null;
        });
        field.addEventListener("failed", ({ error }) => own === this.number && this.fail(error));
      }
      await Promise.all(made.fields.map((field) => field.opened));
      if (own !== this.number || !this.stage) return;
      await this.stage.prepare(made.object);
      if (own !== this.number || !this.stage) return;
      this.stage.scene.add(made.object);
      this.paint();
      this.frame(this.stage, made);
      this.dispatchEvent(new Event("load"));
      if (made.lacks) this.fail(made.lacks);
    } catch (error) {
      if (own !== this.number) return;
      this.opened = null;
      if (made) release(made);
      this.fail(error);
    }
  }

  /** Frames everything visible. */
  private frame(stage: Stage, made: Opened): void {
    stage.show(visibleBox(made), standpoint(made));
    const view = this.kept ?? readViewpoint(this.getAttribute("camera") ?? "");
    if (view) {
      stage.viewpoint = view;
      stage.controls.saveState();
    }
    this.framed = viewpointText(stage.viewpoint);
  }

  private close(): void {
    this.number++;
    this.failure = null;
    this.message.hidden = true;
    if (!this.opened) return;
    this.stage?.scene.remove(this.opened.object);
    release(this.opened);
    this.opened = null;
  }

  private paint(): void {
    const trained = this.fields[0]?.metadata?.background ?? [1, 1, 1];
    // Any color that the browser knows, also one that is seen through or that a variable holds.
    const { style } = this.canvas;
    style.backgroundColor = "";
    style.backgroundColor = this.background;
    this.stage?.setBackground(style.backgroundColor ? null : new Color().setRGB(...trained, SRGBColorSpace));
  }

  private fail(cause: unknown): void {
    if (cause === this.failure) return;
    this.failure = cause;
    const error = cause instanceof FieldError ? cause : new FieldError(cause instanceof Error ? cause.message : String(cause));
    this.words.textContent = `${error.message} ${error.remedy}`;
    this.message.hidden = false;
    this.dispatchEvent(new CustomEvent("error", { detail: error }));
  }
}

/** Whether a stage is available for an element: the offscreen or least recently used element gives up its own. */
function makeRoom(element: MipvogViewer): boolean {
  if (live.length >= MOST_STAGES) {
    const other = live.find((one) => !one.isInView) ?? live.find((one) => one.isAtRest);
    if (!other) {
      waiting.add(element);
      return false;
    }
    other.giveUp();
  }
  waiting.delete(element);
  return true;
}

/** Serves the next waiting element, after an element has finished or left the page. */
function serveWaiting(): void {
  const [next] = waiting;
  if (!next || (live.length >= MOST_STAGES && !live.some((one) => one.isAtRest || !one.isInView))) return;
  waiting.delete(next);
  next.resume();
}

if (globalThis.customElements && !customElements.get("mipvog-viewer")) customElements.define("mipvog-viewer", MipvogViewer);

declare global {
  interface HTMLElementTagNameMap {
    "mipvog-viewer": MipvogViewer;
  }
}

/** @ts-ignore if React's types are not installed */
declare module "react" {
  namespace JSX {
    interface IntrinsicElements {
      /** @ts-ignore as above */
      "mipvog-viewer": import("react").DetailedHTMLProps<import("react").HTMLAttributes<MipvogViewer>, MipvogViewer> & Partial<Pick<MipvogViewer, "src" | "background" | "alt" | "poster">> &
        { camera?: string; loading?: "lazy" | "eager"; "auto-rotate"?: boolean | ""; "disable-zoom"?: boolean | ""; "disable-pan"?: boolean | ""; "distance-limits"?: string; "elevation-limits"?: string; "touch-action"?: string; "max-bytes"?: string | number };
    }
  }
}
