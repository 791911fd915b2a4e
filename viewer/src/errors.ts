/** An error, in words for the user who opened the file. */
export class FieldError extends Error {
  /**
   * @param message what was found where, and what was expected
   * @param remedy how to fix it
   */
  constructor(
    message: string,
    readonly remedy: string = REMEDY.damaged,
  ) {
    super(message);
    this.name = "FieldError";
  }
}

/** Remedies for common errors. */
export const REMEDY = {
  damaged: "The file is cut short or damaged: copy it or bake it again.",
  foreign: "Open a .mipvog container or a .glb asset that holds one.",
  asset: "Give it the ending .glb, or open it where assets are opened.",
  bake: "Bake it first: mipvog-bake bake FILE -o scene.mipvog.",
  unpack: "Unpack it, then open what was in it.",
  page: "Check the address: its server answers with a page.",
  json: "Open a field first: camera files are for its views.",
  browser: "Use a current browser, or switch hardware acceleration on.",
  newer: "Use a newer version of this viewer, or bake the file again.",
  network: "Check the address and the connection, then open it again.",
  foreignHost: "Check the address and the connection; the other host also has to allow this page, by Access-Control-Allow-Origin.",
  decompress: "Write it without this compression to see all of it.",
  policy: "Add mipvog-viewer to trusted-types in the page's Content-Security-Policy.",
  decoder: "Load the page again; worker.js has to lie beside the viewer's script.",
  again: "Open it again.",
  returned: "The picture comes back when the browser returns it.",
  source: "Give the constructor one of these.",
  renderer: "Make a WebGLRenderer.",
  webgpu: 'Import RadianceField from "mipvog-viewer/webgpu", or make a WebGLRenderer.',
  later: "Use pickAsync or statisticsAsync.",
  attachments: "Draw it in a pass of its own, with one color attachment.",
  budget: "Allow more by maxBytes, or bake it with fewer nodes.",
  views: "Draw each view by a camera of its own, or make a WebGLRenderer.",
  depth: "Make the target with a depth buffer.",
  engine: "Make an Engine of Babylon.js on a device with WebGL 2, or a WebGPUEngine.",
  device: "Bake it with fewer nodes, or open it on a device with more graphics memory.",
} as const;
