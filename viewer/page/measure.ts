/** Measuring: distances between points of a picture, and the box around them as an option of the program. */

import { Box3, type Vector3 } from "three";
import type { RadianceField } from "../src/index.js";
import type { Stage } from "../src/stage/stage.js";
import { page } from "./panel.js";

/** A hand that moves so little, in pixels, picks; one that moves more turns. */
const STEADY = 4;
/** Digits of lengths and places. */
const DIGITS = 4;

/** The points, in the field's axes, which are the program's. */
let points: Vector3[] = [];
let isOn = false;
let from: [number, number] | null = null;

/** A number as people read it. */
function short(value: number): string {
  return String(Number(value.toPrecision(DIGITS)));
}

/** Shows what the points say. */
function tell(name: string): void {
  page.measure.hidden = !isOn;
  const lines = [];
  if (points.length === 0) lines.push("Click points of the picture.");
  const [before, last] = points.slice(-2);
  if (before && !last) lines.push(`Point: ${before.toArray().map(short).join(", ")}`);
  if (last) {
    const { min, max } = new Box3().setFromPoints(points);
    lines.push(`Distance of the last two points: ${short(last.distanceTo(before))}`);
    lines.push(`mipvog-bake transcode ${name} --crop=${[...min.toArray(), ...max.toArray()].map(short).join()} -o cropped.mipvog`);
  }
  page.measured.replaceChildren(...lines.map((text, number) => {
    const line = document.createElement(number === 1 ? "code" : "p");
    line.textContent = text;
    return line;
  }));
}

/** Makes the canvas measure while `toggle` has switched it on; `field` is what is measured, `name` that of its file. */
export function bindMeasure(stage: Stage, field: () => RadianceField | null, name: () => string): { toggle(): boolean; forget(): void } {
  page.canvas.addEventListener("pointerdown", ({ offsetX, offsetY }) => (from = isOn ? [offsetX, offsetY] : null));
  page.canvas.addEventListener("pointerup", ({ offsetX, offsetY }) => {
    const shown = field();
    if (!from || !shown || Math.hypot(offsetX - from[0], offsetY - from[1]) > STEADY) return;
    const point = shown.pick(stage.renderer, stage.camera, offsetX / page.canvas.clientWidth, offsetY / page.canvas.clientHeight);
    if (point) points.push(shown.worldToLocal(point));
    tell(name());
  });
  const forget = () => {
    points = [];
    tell(name());
  };
  page.unmeasure.addEventListener("click", forget);
  return {
    toggle() {
      isOn = !isOn;
      forget();
      return isOn;
    },
    forget,
  };
}
