/** The row of tools, and their keys. */

import type { Stage } from "../src/stage/stage.js";
import type { Way } from "../src/stage/walk.js";
import { page, say } from "./panel.js";

/** Each way to move, and the one after it. */
const WAYS: [Way | null, string][] = [
  [null, "Orbit"],
  ["fly", "Fly"],
  ["walk", "Walk"],
];
/** A key of each tool. */
const KEYS: Record<string, string> = { r: "reset", t: "rotate", v: "way", m: "measure", p: "picture", c: "link", f: "full", "?": "help" };

const button = (tool: string) => document.querySelector<HTMLButtonElement>(`[data-tool="${tool}"]`)!;

/** Starts or stops auto-rotation. */
export function setRotation(stage: Stage, isOn: boolean): void {
  stage.controls.autoRotate = isOn;
  button("rotate").ariaPressed = String(isOn);
}

/** Makes the tools work; `name` is that of the file, for pictures of it, and `measure` whether clicks measure from now on. */
export function bindTools(stage: Stage, name: () => string, measure: () => boolean): void {
  const tools: Record<string, () => void> = {
    reset: () => {
      stage.reset();
      showView(stage);
    },
    rotate: () => setRotation(stage, !stage.controls.autoRotate),
    measure: () => (button("measure").ariaPressed = String(measure())),
    way: () => {
      const now = WAYS.findIndex(([way]) => way === stage.way);
      stage.way = WAYS[(now + 1) % WAYS.length][0];
      showView(stage);
      page.canvas.focus();
    },
    picture: () => savePicture(name()),
    link: () => void copyLink(),
    full: () => void (document.fullscreenElement ? document.exitFullscreen() : page.main.requestFullscreen()).catch(() => say("The browser does not allow full screen here.")),
    headset: () => void enter(stage).catch((error) => say(`The headset cannot be used: ${error.message}`)),
    help: () => {
      page.help.showModal();
      // The button to close it has the focus, at the end of the list.
      page.help.scrollTop = 0;
    },
  };
  for (const [tool, use] of Object.entries(tools)) button(tool).addEventListener("click", use);
  for (const one of document.querySelectorAll<HTMLButtonElement>("[data-tool]")) one.ariaLabel = one.title;
  button("full").hidden = !document.fullscreenEnabled;
  bindArrows(button("reset").parentElement!);
  void navigator.xr?.isSessionSupported("immersive-vr").then((has) => (button("headset").hidden = !has), () => {});
  page.embed.addEventListener("click", () => void copyFrame(name()));
  // Keys are for the picture, also before anybody has clicked it.
  document.addEventListener("keydown", (event) => {
    if (event.target !== document.body && event.target !== page.canvas) return;
    const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey && (event.key.length === 1 || event.key.startsWith("Arrow"));
    if (!isPlain) return;
    if (!page.main.classList.contains("empty")) page.canvas.focus();
    const key = event.key.toLowerCase();
    if (key === "l") page.colors.click();
    else if (key in KEYS && !page.main.classList.contains("empty")) button(KEYS[key]).click();
    else return;
    event.preventDefault();
  });
}

/** Makes a tool bar one stop of the Tab key; the arrow keys, Home and End go from tool to tool. */
function bindArrows(bar: HTMLElement): void {
  const all = [...bar.querySelectorAll<HTMLButtonElement>("[data-tool]")];
  const stop = (at: HTMLButtonElement) => all.forEach((one) => (one.tabIndex = one === at ? 0 : -1));
  stop(all[0]);
  bar.addEventListener("focusin", (event) => stop(event.target as HTMLButtonElement));
  bar.addEventListener("keydown", (event) => {
    const shown = all.filter((one) => !one.hidden);
    const now = shown.indexOf(event.target as HTMLButtonElement);
    const next = { ArrowRight: now + 1, ArrowDown: now + 1, ArrowLeft: now - 1, ArrowUp: now - 1, Home: 0, End: -1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    shown.at(next % shown.length)!.focus();
  });
}

/** Brings the controls of the camera to what it does: the way in which it moves, and its field of view. */
export function showView(stage: Stage): void {
  page.way.textContent = WAYS.find(([way]) => way === stage.way)![1];
  const button = page.way.closest("button");
  if (button) button.ariaLabel = `${page.way.textContent}: change how the camera moves (V)`;
  page.fov.value = String(stage.fov);
}

function savePicture(name: string): void {
  page.canvas.toBlob((picture) => {
    if (!picture) return say("The browser makes no picture of this size.");
    const link = document.createElement("a");
    [link.href, link.download] = [URL.createObjectURL(picture), `${name.replace(/\.\w+$/, "")}.png`];
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
}

async function copyLink(): Promise<void> {
  if (await copied(location.href)) say("The link to this view is copied.");
  else say("The link to this view is in the address bar.");
}

/** Copies what shows this view in another page, without tools. */
async function copyFrame(name: string): Promise<void> {
  const address = new URL(location.href);
  address.searchParams.set("ui", "0");
  const quoted = (text: string) => text.replaceAll("&", "&amp;").replaceAll('"', "&quot;");
  const frame = `<iframe src="${quoted(address.href)}" title="${quoted(name)}" width="800" height="533" allow="fullscreen; xr-spatial-tracking" loading="lazy"></iframe>`;
  if (await copied(frame)) say("The code for a page is copied.");
  else say(frame);
}

/** Whether the browser lets the page copy. */
function copied(text: string): Promise<boolean> {
  return navigator.clipboard ? navigator.clipboard.writeText(text).then(() => true, () => false) : Promise.resolve(false);
}

async function enter(stage: Stage): Promise<void> {
  // A headset moves the camera.
  const { viewpoint } = stage;
  const session = await navigator.xr!.requestSession("immersive-vr", { optionalFeatures: ["local-floor"] });
  stage.renderer.xr.enabled = true;
  await stage.renderer.xr.setSession(session);
  session.addEventListener("end", () => {
    stage.renderer.xr.enabled = false;
    stage.viewpoint = viewpoint;
    stage.redraw(true);
  });
}
