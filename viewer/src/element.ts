/** `<mipvog-viewer src="scene.mipvog">`: a field in any page, without a line of script. */

import { Color, SRGBColorSpace } from "three";
import { deviceLimits } from "./device.js";
import { FieldError } from "./errors.js";
import type { RadianceField } from "./three/field.js";
import { type Opened, openAddress, release, standpoint, visibleBox } from "./stage/opened.js";
import { Stage } from "./stage/stage.js";
import { viewpointText } from "./stage/viewpoint.js";

const STYLE = `
:host { display: block; position: relative; width: 100%; aspect-ratio: 3 / 2; }
:host([hidden]) { display: none; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; }
p { position: absolute; inset: auto 0 0; margin: 0; padding: 0.5em; color: #fff; background: #000c; }
`;

/** What an element is made of; servers, which draw pages and show nothing, have nothing of the kind. */
const Base = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;
/** What a picture shows of which nobody says it. */
const UNNAMED = "A radiance field";
const ATTRIBUTES = ["src", "background", "alt"] as const;

/**
 * Attributes, and properties of the same names: `src`, the address of a `.mipvog`, `.glb` or `.gltf`; `background`, a CSS color
 * in place of the one it was trained on; `alt`, what the picture shows. Events: `load` when the first level can be drawn, `error`, whose `detail` is a
 * `FieldError`. An error is shown in the element, too.
 */
export class MipvogViewer extends Base {
  static readonly observedAttributes: readonly string[] = ATTRIBUTES;
  /** Camera, renderer and scene; null until the device is started, and while the element is in no page. */
  stage: Stage | null = null;
  private opened: Opened | null = null;
  private readonly canvas = document.createElement("canvas");
  private readonly message = document.createElement("p");
  private number = 0;
  /** What was told last: one failure can come in several ways. */
  private failure: unknown = null;
  /** The view that the element chose. */
  private framed = "";

  constructor() {
    super();
    // Allowed by a content security policy without inline styles.
    const style = new CSSStyleSheet();
    style.replaceSync(STYLE);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.ariaLabel = UNNAMED;
    this.message.setAttribute("role", "alert");
    this.message.hidden = true;
    const root = this.attachShadow({ mode: "open" });
    root.adoptedStyleSheets = [style];
    root.append(this.canvas, this.message);
  }

  /** The fields that are shown. */
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

  private reflect(name: (typeof ATTRIBUTES)[number], value: string | null | undefined): void {
    if (value === null || value === undefined) this.removeAttribute(name);
    else this.setAttribute(name, value);
  }

  connectedCallback(): void {
    for (const name of ATTRIBUTES) {
      // What was set before the element was known hides the property.
      if (!Object.hasOwn(this, name)) continue;
      const value = this[name];
      delete (this as Partial<Record<typeof name, string>>)[name];
      this[name] = value;
    }
    void this.start();
  }

  /** Makes the stage, on a device that is started: its context would hold the page up where it started one. */
  private async start(): Promise<void> {
    try {
      await deviceLimits();
      // Meanwhile it may have left the page, or left it and come back.
      if (!this.isConnected || this.stage) return;
      this.stage = new Stage(this.canvas);
      void this.load();
    } catch (error) {
      this.fail(error);
    }
  }

  disconnectedCallback(): void {
    this.close();
    this.stage?.dispose();
    this.stage = null;
  }

  attributeChangedCallback(name: string): void {
    if (name === "alt") this.canvas.ariaLabel = this.alt || UNNAMED;
    if (!this.stage) return;
    if (name === "background") this.paint();
    else if (name === "src") void this.load();
  }

  private async load(): Promise<void> {
    this.close();
    const own = this.number;
    const address = this.getAttribute("src");
    if (!address) return;
    let made: Opened | null = null;
    try {
      made = await openAddress(new URL(address, document.baseURI).href);
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

  /** Looks at all that is to be seen. */
  private frame(stage: Stage, made: Opened): void {
    stage.show(visibleBox(made), standpoint(made));
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
    this.message.textContent = `${error.message} ${error.remedy}`;
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

/** @ts-ignore where React's types are not installed, nothing is said of them. */
declare module "react" {
  namespace JSX {
    interface IntrinsicElements {
      /** @ts-ignore as above */
      "mipvog-viewer": import("react").DetailedHTMLProps<import("react").HTMLAttributes<MipvogViewer>, MipvogViewer> & Partial<Pick<MipvogViewer, "src" | "background" | "alt">>;
    }
  }
}
