/** What the panel says. */

import type { Budget, RadianceField, Statistics } from "../src/index.js";
import { levelOfPart, partsOf } from "../src/format/parts.js";
import { levelTint } from "../src/render/shader.js";

const TRANSFERS = {
  ranges: "in parts",
  whole: "whole: the server offers no parts",
  memory: "from memory",
} as const;

function element<E extends HTMLElement>(id: string): E {
  return document.getElementById(id) as E;
}

export const page = {
  main: document.querySelector("main")!,
  canvas: element<HTMLCanvasElement>("picture"),
  progress: element<HTMLProgressElement>("progress"),
  hint: element("hint"),
  error: element("error"),
  panel: element<HTMLDetailsElement>("panel"),
  name: element("name"),
  fov: element<HTMLInputElement>("fov"),
  background: element<HTMLInputElement>("background"),
  trained: element("trained"),
  views: element<HTMLSelectElement>("views"),
  colors: element<HTMLInputElement>("colors"),
  legend: element("legend"),
  numbers: element<HTMLDetailsElement>("numbers"),
  facts: element("facts"),
  level: element<HTMLSelectElement>("level"),
  beside: element("beside"),
  cameras: element("cameras"),
  split: element("split"),
  at: element<HTMLInputElement>("at"),
  line: element("line"),
  way: element("way"),
  said: element("said"),
  measure: element("measure"),
  measured: element("measured"),
  unmeasure: element("unmeasure"),
  poster: element<HTMLImageElement>("poster"),
  embed: element("embed"),
  sides: [element("left"), element("right")],
  help: element<HTMLDialogElement>("help"),
  chooser: element<HTMLInputElement>("chooser"),
  openers: [element("open"), element("another")],
};

/** A message stands for so long. */
const SAID_MS = 4000;
let saying = 0;

/** Says something in passing. */
export function say(text: string): void {
  clearTimeout(saying);
  page.said.textContent = text;
  saying = window.setTimeout(() => (page.said.textContent = ""), SAID_MS);
}

/** Names what is shown; null while there is nothing. */
export function showName(name: string | null): void {
  page.main.classList.toggle("empty", name === null);
  page.name.textContent = name ?? "Field";
  if (name !== null) page.canvas.ariaLabel = `${name}. Arrow keys turn it, with shift they move it, plus and minus zoom, R starts over, a question mark shows all keys.`;
  document.title = name === null ? "Mip-VoG viewer" : `${name} – Mip-VoG viewer`;
}

/** Bytes in the unit that people read, as the program prints them. */
export function readable(bytes: number): string {
  const units = ["B", "kB", "MB", "GB"];
  let unit = 0;
  let value = bytes;
  for (; value >= 1000 && unit + 1 < units.length; unit++) value /= 1000;
  return unit === 0 ? `${bytes} B` : `${value.toFixed(2)} ${units[unit]}`;
}

/** What a field takes of the device's memory. */
function memory({ bytes, most, blocks: [held, known] }: Budget): string {
  const room = held < known ? `; room for ${held} of ${known} blocks, those near the camera` : "";
  return `${readable(bytes)}, of ${readable(most)}${room}`;
}

/** Shows an error in plain words, with what to do `again`, if anything; or takes it away. */
export function showError(error: { message: string; remedy?: string } | null, heading = "", again: (() => void) | null = null): void {
  page.error.hidden = !error;
  page.error.replaceChildren();
  if (!error) return;
  const title = document.createElement("b");
  title.textContent = heading;
  const lines = [error.message, error.remedy ?? ""].filter(Boolean).map((text) => {
    const line = document.createElement("p");
    line.textContent = text;
    return line;
  });
  const close = document.createElement("button");
  [close.type, close.textContent] = ["button", "Close"];
  close.addEventListener("click", () => {
    page.error.hidden = true;
    // Where nothing is shown, another file can be chosen.
    page.hint.hidden = !page.main.classList.contains("empty");
  });
  const retry = document.createElement("button");
  [retry.type, retry.textContent, retry.hidden] = ["button", "Try again", !again];
  retry.addEventListener("click", () => again?.());
  page.error.append(title, ...lines, retry, " ", close);
}

/** The choice of levels of a field. */
export function offerLevels(field: RadianceField | null): void {
  const levels = field?.metadata?.levels ?? [];
  const options = [["", "by distance"], ...levels.map((level, i) => [String(i), `${i}: ${level.dimensions.join(" × ")}`])];
  page.level.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  page.legend.replaceChildren(
    ...levels.map(({ dimensions }, i) => {
      const [row, color] = [document.createElement("li"), document.createElement("i")];
      color.style.background = `rgb(${levelTint(i, levels.length).map((value) => Math.round(255 * value)).join()})`;
      const place = i === 0 ? ", the finest" : i + 1 === levels.length ? ", the coarsest" : "";
      row.append(color, `Level ${i}${place}: ${dimensions.join(" × ")}`);
      return row;
    }),
  );
}

/** Brings the facts up to date. With every picture, so that only what has changed is written. */
export function showFacts(name: string, field: RadianceField | null, frameTime: number | null, statistics: Statistics | null): void {
  const rows: [string, string][] = [["File", name]];
  const { metadata, file } = field ?? {};
  if (field && metadata && file) {
    const shown = field.finest;
    const levels = metadata.levels.length;
    const stored = partsOf(metadata).map(({ blocks_stored: blocks }, part) => ({ blocks, level: levelOfPart(metadata, part) }));
    const sum = (parts: typeof stored) => parts.reduce((sum, { blocks }) => sum + blocks, 0);
    const blocks = sum(stored.filter(({ level }) => shown !== null && level >= shown));
    const { finest } = file.plan;
    const missing = finest > file.available ? "do not fit this device" : "are not in this part of the file";
    rows.push(
      ["Level", shown === null ? "none yet" : `${shown}, of ${levels}${finest > 0 ? `; those before ${finest} ${missing}` : ""}`],
      ["Nodes", metadata.levels[shown ?? levels - 1].dimensions.join(" × ")],
      ["Blocks", `${blocks} of ${sum(stored)}`],
      ["Bytes", field.arrived < file.fileBytes ? `${readable(field.arrived)} of ${readable(file.fileBytes)}` : readable(file.fileBytes)],
      ["Comes", TRANSFERS[file.transfer]],
    );
    if (field.budget) rows.push(["Memory", memory(field.budget)]);
  }
  if (frameTime !== null) rows.push(["Frame", `${frameTime.toFixed(1)} ms`]);
  if (statistics && statistics.rays > 0) {
    rows.push(["Samples a ray", statistics.samplesPerRay.toFixed(1)]);
    rows.push(["Fetches a sample", (statistics.fetchesPerRay / Math.max(statistics.samplesPerRay, 1e-9)).toFixed(1)]);
  }
  const cells = rows.flat();
  if (page.facts.childElementCount !== cells.length) {
    page.facts.replaceChildren(...cells.map((_, i) => document.createElement(i % 2 === 0 ? "dt" : "dd")));
  }
  cells.forEach((text, i) => {
    const cell = page.facts.children[i];
    if (cell.textContent !== text) cell.textContent = text;
  });
}
