/** Places to look from: in the page's address, and from a camera file. */

import { FieldError, REMEDY } from "../src/errors.js";
import type { RadianceField } from "../src/index.js";
import type { Stage } from "../src/stage/stage.js";
import { type Preset, presetViewpoint, readPresets, readViewpoint, type Viewpoint, viewpointText } from "../src/stage/viewpoint.js";
import { page } from "./panel.js";
import { showView } from "./tools.js";

/** The address is brought up to date after the view rests for so long. */
const REST_MS = 300;

/** What a camera in a world turns around is this part of the innermost box away, at least. */
const INSIDE = 0.25;

let presets: Preset[] = [];
let waiting = 0;

/** The view that the page's address names: a link to it, or what a frame starts with. */
export function addressedView(): Viewpoint | null {
  const text = new URLSearchParams(location.hash.slice(1)).get("view") ?? new URLSearchParams(location.search).get("camera");
  return text === null ? null : readViewpoint(text);
}

/** Names the stage's view in the address, unless it is still the one of `framed`. */
export function nameView(stage: Stage, framed: string): void {
  clearTimeout(waiting);
  waiting = window.setTimeout(() => {
    const text = viewpointText(stage.viewpoint);
    if (text === framed) return;
    // Pages that are a file in a frame have no address of their own.
    try {
      history.replaceState(null, "", `#view=${text}`);
    } catch {}
  }, REST_MS);
}

/** Takes the name of a view out of the address: another file is shown. */
export function forgetView(): void {
  clearTimeout(waiting);
  try {
    if (location.hash) history.replaceState(null, "", location.pathname + location.search);
  } catch {}
}

/** Offers the cameras of a file at an address. */
export async function fetchCameras(address: string): Promise<void> {
  const response = await fetch(address).catch(() => null);
  if (!response?.ok) throw new FieldError(`The camera file ${address} cannot be had${response ? `: its server answers ${response.status}` : ""}.`, REMEDY.network);
  await openCameras(new File([await response.blob()], address));
}

/** Offers the cameras of a file. */
export async function openCameras(file: File): Promise<void> {
  presets = readPresets(await file.text(), file.name);
  page.views.replaceChildren(new Option("choose", ""), ...presets.map(({ name }, number) => new Option(name, String(number))));
  page.views.parentElement!.hidden = false;
}

/** Goes to a view, and shows in the controls what it is. */
export function goTo(stage: Stage, view: Viewpoint): void {
  stage.viewpoint = view;
  showView(stage);
}

/** Goes to the camera that was chosen. */
export function goToChosen(stage: Stage, field: RadianceField | null): void {
  const preset = presets[Number(page.views.value)];
  if (page.views.value === "" || !preset || !field) return;
  goTo(stage, viewOf(preset, field));
}

/** What the first camera of a file sees; null without one. */
export function firstView(field: RadianceField | null): Viewpoint | null {
  return field && presets.length > 0 ? viewOf(presets[0], field) : null;
}

function viewOf(preset: Preset, field: RadianceField): Viewpoint {
  field.updateWorldMatrix(true, false);
  const box = field.visibleBounds.applyMatrix4(field.matrixWorld);
  const size = box.getSize(box.min.clone());
  // Cameras of a world stand in what they would turn around.
  const least = field.isWorld ? INSIDE * Math.min(size.x, size.y, size.z) : undefined;
  return presetViewpoint(preset, field.matrixWorld, box.getCenter(box.min.clone()), least);
}
