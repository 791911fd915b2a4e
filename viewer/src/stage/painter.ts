/**
 * Draws pictures in short draws. During movement, whole pictures of fewer pixels are drawn and enlarged. At rest, a
 * finer one follows, then the full picture in strips from the middle outward, over the previous picture. The canvas
 * keeps its size, because browsers wait for the device when it changes.
 */

import { type Object3D, type PerspectiveCamera, type Scene, Vector2, type WebGLRenderer } from "three";
import { whenDone } from "../render/fence.js";
import { Enlarger } from "./enlarger.js";

/** Time limit of a picture during movement, in milliseconds. */
const SMOOTH_MS = 40;
/** Time limit of a part of a still picture. It is longer, because browsers composite the whole page after each part. */
const PART_MS = 100;
/** Minimum share of the pixels along each side during movement. */
const COARSEST = 1 / 32;
/**
 * At rest, if the picture is coarser than this share, one of this share precedes the full picture, or as fine as this
 * time allows.
 */
const [BETWEEN, BETWEEN_MS] = [1 / 4, 400];
/** Without movement for this long, in milliseconds, pictures become sharp. */
const REST_MS = 200;
/** Rows and columns of the smallest part of a picture. */
const CELL = 32;
/** Maximum factor between the pixels of one draw and the next. */
const GROWTH = 4;

/** Two objects, left and right of a line; `at` is the position of the line, 0 to 1. */
export interface Split {
  left: Object3D;
  right: Object3D;
  at: number;
}

export class Painter {
  /** Time of the last whole picture in milliseconds; null before the first. */
  frameTime: number | null = null;
  /** Called after each whole picture, coarse or full. */
  drawn: () => void = () => {};
  split: Split | null = null;
  private size: [number, number] = [1, 1];
  /** Pixels along a side of the last picture, as a share of those of the screen. */
  sharpness = 1;
  private moved = -Infinity;
  private isStale = true;
  /** Whether the next picture must appear immediately. */
  private isFresh = true;
  /** Whether the device is still working. */
  isBusy = false;
  private waits = false;
  /**
   * The finished rows of the full picture, and the finished columns of the next rows above or below; null if the
   * picture is complete.
   */
  private cursor: { top: number; bottom: number; column: number } | null = null;
  /** Whether the picture between the coarse and the full one was drawn. */
  private isBetween = false;
  private spent = 0;
  /** Start time of the last draw. */
  private began = 0;
  /** Pixels per millisecond of the last whole picture, and of the last draw. */
  private wholeRate: number | null = null;
  private rate: number | null = null;
  private readonly enlarger: Enlarger;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly scene: Scene,
    private readonly camera: PerspectiveCamera,
    /** Nothing is drawn after this signal. */
    private readonly ended: AbortSignal,
  ) {
    renderer.setPixelRatio(1);
    this.enlarger = new Enlarger(renderer.getContext() as WebGL2RenderingContext, ended);
  }

  /** Whether the picture is complete and shows everything loaded. */
  get settled(): boolean {
    return !this.isStale && !this.isBusy && this.cursor === null && this.sharpness === 1;
  }

  /** Redraws. `fresh` shows a coarse picture before the full one. */
  redraw(fresh = false): void {
    this.isStale = true;
    this.isFresh ||= fresh;
  }

  /** Redraws because the camera moved. */
  move(): void {
    this.moved = performance.now();
    this.isStale = true;
  }

  /** Changes the size of the canvas, in screen pixels. */
  resize(width: number, height: number): void {
    if (width === this.size[0] && height === this.size[1]) return;
    this.size = [width, height];
    this.redraw(true);
  }

  /**
   * Draws what is due; call it every frame. If content `waits`, no full picture is drawn, because it would change soon.
   */
  draw(waits: boolean): void {
    this.waits = waits;
    if (this.isBusy || this.renderer.getContext().isContextLost()) return;
    const isMoving = performance.now() - this.moved < REST_MS;
    if (this.isStale && (isMoving || this.isFresh)) this.drawCoarse(SMOOTH_MS);
    else if (waits) return;
    else if (!isMoving && !this.isBetween && this.sharpness < BETWEEN) this.drawCoarse(BETWEEN_MS, BETWEEN);
    else if (this.isStale || (!isMoving && this.sharpness < 1)) this.startFull();
    else if (this.cursor && !isMoving) this.drawPart(this.cursor);
  }

  /** Draws a whole picture that takes about the given time, with at most a share of the pixels along each side. */
  private drawCoarse(time: number, most = 1): void {
    [this.isStale, this.isFresh, this.cursor, this.isBetween] = [false, false, null, time !== SMOOTH_MS];
    const [width, height] = this.size;
    const affordable = Math.sqrt(((this.wholeRate ?? 0) * time) / (width * height));
    this.sharpness = Math.min(most, Math.max(COARSEST, affordable));
    const [wide, high] = this.size.map((pixels) => Math.max(1, Math.round(pixels * this.sharpness)));
    const now = this.renderer.getSize(new Vector2());
    if (now.x !== width || now.y !== height) this.renderer.setSize(width, height, false);
    this.renderer.setViewport(0, 0, wide, high);
    this.paint([0, 0, wide, high], [wide, high]);
    this.renderer.setViewport(0, 0, width, height);
    if (this.sharpness < 1) {
      this.enlarger.spread(wide, high, this.size);
      this.renderer.resetState();
    }
    this.whenDone(wide * high, (time) => {
      this.wholeRate = this.rate;
      this.frameTime = time;
      this.drawn();
    });
  }

  private startFull(): void {
    const middle = Math.floor(this.size[1] / 2 / CELL) * CELL;
    [this.isStale, this.sharpness, this.cursor, this.spent] = [false, 1, { top: middle, bottom: middle, column: 0 }, 0];
    this.drawPart(this.cursor);
  }

  /** Draws as many cells as the time allows, below or above the finished ones. */
  private drawPart({ top, bottom, column: x }: { top: number; bottom: number; column: number }): void {
    const [width, height] = this.size;
    // Rows of background say nothing about those of the field, but the whole picture has both.
    const rate = Math.min(this.rate ?? 0, this.wholeRate ?? 0);
    const cells = Math.max(1, Math.floor((rate * PART_MS) / CELL ** 2));
    const rows = Math.floor(cells / Math.ceil(width / CELL));
    const wide = x === 0 && rows > 0 ? width : Math.min(width - x, cells * CELL);
    // What is nearer to the middle comes first.
    const isBelow = bottom < height && (top === 0 || bottom - height / 2 <= height / 2 - top);
    const high = Math.min(isBelow ? height - bottom : top, wide === width ? Math.max(1, rows) * CELL : CELL);
    const y = isBelow ? bottom : top - high;
    const next = x + wide < width ? { top, bottom, column: x + wide } : { top: isBelow ? top : y, bottom: isBelow ? y + high : bottom, column: 0 };
    this.cursor = next.top === 0 && next.bottom === height ? null : next;
    const isLast = this.cursor === null;
    this.paint([x, y, wide, high], this.size);
    this.whenDone(wide * high, (time) => {
      this.spent += time;
      if (!isLast) return this.draw(this.waits);
      this.frameTime = this.spent;
      this.drawn();
    });
  }

  /** Draws a part of a picture of the given size. Rows count from the top. */
  private paint([x, y, width, height]: number[], [whole, rows]: number[]): void {
    this.began = performance.now();
    const { split } = this;
    const line = split ? Math.round(whole * split.at) : whole;
    const side = (from: number, to: number) => {
      const left = Math.max(x, from);
      if (left >= Math.min(x + width, to)) return;
      this.renderer.setScissor(left, rows - y - height, Math.min(x + width, to) - left, height);
      this.renderer.render(this.scene, this.camera);
    };
    const show = (left: boolean, right: boolean) => split && ([split.left.visible, split.right.visible] = [left, right]);
    this.renderer.setScissorTest(true);
    show(true, false);
    side(0, line);
    show(false, true);
    side(line, whole);
    show(true, true);
    this.renderer.setScissorTest(false);
  }

  /** Calls back with the elapsed time when the device has drawn this many pixels. */
  private whenDone(drawn: number, then: (time: number) => void): void {
    this.isBusy = true;
    whenDone(this.renderer.getContext() as WebGL2RenderingContext, () => {
      if (this.ended.aborted) return;
      this.isBusy = false;
      const time = performance.now() - this.began;
      const rate = drawn / Math.max(time, 0.1);
      this.rate = Math.min(rate, GROWTH * (this.rate ?? rate));
      then(time);
    });
  }
}
