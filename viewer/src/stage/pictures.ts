/** Shaders before they draw, and pictures that are not shown. */

import { type Camera, type Material, type Mesh, type Object3D, PerspectiveCamera, type Scene, Vector2, type WebGLRenderer } from "three";
import { FieldError, REMEDY } from "../errors.js";
import { whenDone } from "../render/fence.js";

/** Compiles the shaders of an object, and waits for them where the device can say so. */
export async function compiled(renderer: WebGLRenderer, object: Object3D, camera: Camera, scene: Scene): Promise<void> {
  if (renderer.extensions.has("KHR_parallel_shader_compile")) await renderer.compileAsync(object, camera, scene);
  else renderer.compile(object, camera, scene);
  const gl = renderer.getContext() as WebGL2RenderingContext;
  // A device that cannot say whether it has compiled them has them by then, or nearly so.
  await new Promise<void>((done) => whenDone(gl, done));
  for (const program of programsOf(renderer, object)) {
    // The answer comes with all that the first draw has to know of the program.
    if (gl.getProgramParameter(program, gl.LINK_STATUS) || gl.isContextLost()) continue;
    throw new FieldError(`The device does not take the shader: ${gl.getProgramInfoLog(program)?.trim()}`, REMEDY.device);
  }
}

function programsOf(renderer: WebGLRenderer, object: Object3D): Set<WebGLProgram> {
  const programs = new Set<WebGLProgram>();
  object.traverse((part) => {
    for (const material of [(part as Partial<Mesh>).material ?? []].flat() as Material[]) {
      const made = renderer.properties.get(material) as { programs?: Map<string, { program: WebGLProgram }> };
      for (const { program } of made.programs?.values() ?? []) programs.add(program);
    }
  });
  return programs;
}

/** A camera with a transform (column-major) and a focal length in pixels. */
export interface Shot {
  width: number;
  height: number;
  toWorld: number[];
  focal: number;
}

/** Renders a picture to the renderer's canvas: rows from the top. The canvas keeps its size. */
export function captured(renderer: WebGLRenderer, scene: Scene, like: PerspectiveCamera, { width, height, toWorld, focal }: Shot): Uint8ClampedArray {
  const size = renderer.getSize(new Vector2());
  renderer.setSize(width, height, false);
  const camera = new PerspectiveCamera(1, 1, like.near, like.far);
  camera.matrixWorldAutoUpdate = camera.matrixAutoUpdate = false;
  camera.matrixWorld.fromArray(toWorld);
  camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
  const [x, y] = [(width / 2 / focal) * camera.near, (height / 2 / focal) * camera.near];
  camera.projectionMatrix.makePerspective(-x, x, y, -y, camera.near, camera.far);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const rows = new Uint8ClampedArray(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  const pixels = new Uint8ClampedArray(rows.length);
  for (let row = 0; row < height; row++) pixels.set(rows.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
  renderer.setSize(size.x, size.y, false);
  return pixels;
}
