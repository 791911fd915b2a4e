/** The material of meshes that show a field. */

import { BackSide, type BufferGeometry, type Camera, Data3DTexture, GLSL3, type Mesh, type Object3D, RawShaderMaterial, type Scene, Texture, type WebGLRenderer } from "three";
import type { Opened } from "../load/loader.js";
import { fragmentShader, VERTEX } from "../render/shader.js";
import { SAMPLERS, type Textures } from "../render/textures.js";
import type { Uniforms, View } from "../render/uniforms.js";
import { gpuDrawing } from "./drawing.js";
import { type AnyRenderer, viewOf } from "./view.js";

/** The data for one draw. */
export interface Draw {
  textures: Textures;
  /** Uniforms that follow the camera. */
  uniforms: Uniforms;
}

/** Called before every draw; null if nothing is drawn. */
export type Prepare = (renderer: AnyRenderer, object: Mesh, view: () => View) => Draw | null;

/** The material of a field. Any mesh with this material and the geometry of the field draws the field. */
export class FieldMaterial extends RawShaderMaterial {
  /** WebGPU renderers map this type to their own material. */
  override readonly type = "MipvogFieldMaterial";

  /** Properties of the render target, with WebGPU. */
  variant = "";

  /** `values` are all uniforms, as before the first picture. */
  constructor(
    readonly opened: Opened,
    readonly values: Uniforms,
    readonly prepare: Prepare,
  ) {
    // Raw, so that every target is drawn by the same program.
    super({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: fragmentShader(opened),
      uniforms: glUniforms(values),
      // Rays are entered by the far sides of the box, so that a camera may stand in it.
      side: BackSide,
      transparent: true,
      premultipliedAlpha: true,
    });
  }

  override onBeforeRender(renderer: WebGLRenderer, _scene: Scene, camera: Camera, _geometry: BufferGeometry, object: Object3D): void {
    const draw = this.prepare(renderer, object as Mesh, () => viewOf(camera, object.matrixWorld.elements, renderer));
    if (!draw) return;
    for (const [name, { handle }] of Object.entries(draw.textures)) {
      // A renderer, or one whose device came back, has not seen what it did not make.
      const known = renderer.properties.get(this.uniforms[name].value) as { __webglTexture?: WebGLTexture; __webglInit?: boolean };
      [known.__webglTexture, known.__webglInit] = [handle as WebGLTexture, true];
    }
    for (const [name, value] of Object.entries(draw.uniforms)) this.uniforms[name].value = value;
    this.uniformsNeedUpdate = true;
  }

  /** Key by which WebGPU renderers share what they build. */
  override customProgramCacheKey(): string {
    return gpuDrawing() ? `MIPVOG ${numberOf(this.opened)} ${this.variant}` : super.customProgramCacheKey();
  }

  override clone(): this {
    return new FieldMaterial(this.opened, this.values, this.prepare) as this;
  }
}

/** Uniforms for three.js, which reads their list once. */
function glUniforms(values: Uniforms): RawShaderMaterial["uniforms"] {
  const samplers = SAMPLERS.map((name) => [name, { value: name === "u_weights" ? new Texture() : new Data3DTexture() }]);
  return Object.fromEntries([...samplers, ...Object.entries(values).map(([name, value]) => [name, { value }])]);
}

const numbers = new WeakMap<Opened, number>();
let count = 0;

function numberOf(opened: Opened): number {
  let number = numbers.get(opened);
  if (number === undefined) numbers.set(opened, (number = count++));
  return number;
}
