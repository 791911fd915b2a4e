/** `<mipvog-viewer src="scene.mipvog">`: a field in any page, without scripting. */

import { Color, SRGBColorSpace, Vector3 } from "three";
import { deviceLimits } from "./device.js";
import { ATTRIBUTES, pair, STYLE, TEXTS, UNNAMED } from "./elementParts.js";
import { FieldError, REMEDY } from "./errors.js";
import type { RadianceField } from "./three/field.js";
import { type Opened, openAddress, release, standpoint, visibleBox } from "./stage/opened.js";
import { Stage } from "./stage/stage.js";
import { drop, forget, hold, makeRoom, serveWaiting, type StageHolder, use } from "./stage/stages.js";
import { readViewpoint, type Viewpoint, viewpointText } from "./stage/viewpoint.js";

/** The base class of the element. Servers, which render pages without showing them, have none. */
const Base = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;
/** Elements with `loading="lazy"`, and those that gave up their stage, start when they are this close to the window. */
const NEAR = "200px";
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
export class MipvogViewer extends Base implements StageHolder {
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
  /** Whether it is near the window. */
  isInView = true;
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
    again.addEventListener("click", () => this.retry());
    this.message.append(this.words, " ", again);
    [this.image.part.value, this.message.part.value] = ["poster", "message"];
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
    this.canvas.part.value = "picture";
    this.canvas.setAttribute("role", "application");
    this.canvas.ariaLabel = this.alt || UNNAMED;
  }

  /** Returns to the first view: that of `camera`, or all that is visible. */
  reset(): void {
    this.kept = null;
    if (this.stage && this.opened) this.frame(this.stage, this.opened);
  }

  /** The picture as it is shown, as a PNG; null before there is one. */
  toBlob(): Promise<Blob | null> {
    return this.stage?.hasDrawn ? new Promise((done) => this.canvas.toBlob(done)) : Promise.resolve(null);
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
    this.isInView = this.getAttribute("loading") !== "lazy";
    this.watch = new IntersectionObserver((entries) => {
      this.isInView = entries.at(-1)!.isIntersecting;
      if (this.isInView) void this.start();
    }, { rootMargin: NEAR });
    this.watch.observe(this);
    this.showPoster();
    if (this.isInView) void this.start();
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
      hold(this);
      this.watchDevice(this.stage);
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
    if (this.isInView) void this.start();
  }

  /** Marks the element as recently used, so that it gives up its stage last. */
  private use(): void {
    if (!use(this)) void this.start();
  }

  private end(): void {
    this.close();
    this.stage?.dispose();
    this.stage = null;
    drop(this);
  }

  /** Ends the stage, and takes another canvas: the old one keeps its context. */
  private endForGood(): void {
    const canvas = document.createElement("canvas");
    this.end();
    this.canvas.replaceWith(canvas);
    this.canvas = canvas;
    this.dress();
  }

  /** Reports the loss of the context, which the browser may return. */
  private watchDevice(stage: Stage): void {
    const lost = new FieldError("The graphics device was taken away.", REMEDY.returned);
    this.canvas.addEventListener("webglcontextlost", () => this.stage === stage && this.fail(lost));
    this.canvas.addEventListener("webglcontextrestored", () => {
      if (this.failure !== lost) return;
      this.failure = null;
      this.message.hidden = true;
    });
  }

  /** Loads the scene again, on another device if the context was lost. */
  private retry(): void {
    if (this.stage?.renderer.getContext().isContextLost()) {
      this.kept = this.stage.viewpoint;
      this.endForGood();
    }
    void (this.stage ? this.load() : this.start());
  }

  disconnectedCallback(): void {
    this.watch?.disconnect();
    forget(this);
    // The context is of no use to anybody else, and there are few.
    if (this.stage) this.endForGood();
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

  /** Applies the attributes to the camera's controls. */
  private arrange(): void {
    const { stage } = this;
    if (!stage) return;
    stage.controls.autoRotate = this.hasAttribute("auto-rotate") && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    stage.controls.enableZoom = !this.hasAttribute("disable-zoom");
    stage.controls.enablePan = !this.hasAttribute("disable-pan");
    stage.limits = { distance: pair(this.getAttribute("distance-limits")), elevation: pair(this.getAttribute("elevation-limits")) };
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
    // Any color that the browser knows, also one that is seen through or that a variable holds.
    const { style } = this.canvas;
    style.backgroundColor = "";
    style.backgroundColor = this.background;
    this.stage?.setBackground(style.backgroundColor ? null : new Color().setRGB(...(this.fields[0]?.metadata?.background ?? ([1, 1, 1] as const)), SRGBColorSpace));
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
