/** The parts of Babylon.js's two kinds of engines that a field needs. */

import { Constants } from "@babylonjs/core/Engines/constants.js";
import type { Engine } from "@babylonjs/core/Engines/engine.js";
import { WebGLHardwareTexture } from "@babylonjs/core/Engines/WebGL/webGLHardwareTexture.js";
import type { WebGPUHardwareTexture } from "@babylonjs/core/Engines/WebGPU/webgpuHardwareTexture.js";
import type { WebGPUEngine } from "@babylonjs/core/Engines/webgpuEngine.js";
import type { Effect } from "@babylonjs/core/Materials/effect.js";
import { ShaderLanguage } from "@babylonjs/core/Materials/shaderLanguage.js";
import type { IShaderMaterialOptions } from "@babylonjs/core/Materials/shaderMaterial.js";
import { InternalTexture, InternalTextureSource } from "@babylonjs/core/Materials/Textures/internalTexture.js";
import type { Scene } from "@babylonjs/core/scene.js";
import { FieldError, REMEDY } from "../errors.js";
import type { Opened } from "../load/loader.js";
import { glDevice } from "../render/glDevice.js";
import { gpuDevice } from "../render/gpuDevice.js";
import { fragmentShader, VERTEX } from "../render/shader.js";
import type { DeviceTexture, TextureDevice } from "../render/textureDevice.js";
import { SAMPLERS } from "../render/textures.js";
import type { Uniforms } from "../render/uniforms.js";
import { Data } from "../render/wgsl/data.js";
import { CORNER, textureTypes, wgslSource } from "../render/wgsl/source.js";
import { setUniforms } from "./uniforms.js";

/** How an engine draws fields. */
export interface Drawing {
  readonly device: TextureDevice;
  /** Depth range of clip space: see `View.depth`. */
  readonly depth: [number, number];
  /**
   * The shader of a field, for uniforms with the names and lengths of `example`, and the function that sets them before
   * each draw.
   */
  shader(opened: Opened, example: Uniforms): { source: { vertexSource: string; fragmentSource: string }; options: Partial<IShaderMaterialOptions>; set(effect: Effect, values: Uniforms): void };
  /** Why the current target cannot show a field; null if it can. */
  refusal(): readonly [message: string, remedy: string] | null;
  /** Wraps a texture that the engine did not make, for drawing from it. */
  wrap(texture: DeviceTexture): InternalTexture;
  /** Reads the bound target immediately, four numbers per pixel; null if the engine cannot. */
  readNow: ((width: number, height: number) => Float32Array) | null;
  /** Reads a target's texture asynchronously, four numbers per pixel. */
  read(texture: InternalTexture, width: number, height: number): Promise<Float32Array>;
}

/** The `Drawing` of a scene's engine. */
export function drawingOf(scene: Scene): Drawing {
  const engine = scene.getEngine();
  const { _gl: context } = engine as Engine;
  if (context instanceof WebGL2RenderingContext) return new GlDrawing(engine as Engine, context);
  if (engine.isWebGPU) return new GpuDrawing(engine as unknown as WebGPUEngine);
  throw new FieldError("Fields are drawn by Babylon.js's engines for WebGL 2 and WebGPU, and by no other.", REMEDY.engine);
}

/** As raw text, so that Babylon.js does not add or change anything. */
const VERSION = "#version 300 es\n";

class GlDrawing implements Drawing {
  readonly device: TextureDevice;
  readonly depth: [number, number] = [0.5, 0.5];

  constructor(
    private readonly engine: Engine,
    private readonly context: WebGL2RenderingContext,
  ) {
    this.device = glDevice(context);
  }

  shader(opened: Opened): ReturnType<Drawing["shader"]> {
    const source = { vertexSource: VERSION + VERTEX, fragmentSource: VERSION + fragmentShader(opened) };
    return { source, options: { samplers: [...SAMPLERS] }, set: (_, values) => setUniforms(this.context, values) };
  }

  wrap({ handle }: DeviceTexture): InternalTexture {
    const internal = new InternalTexture(this.engine, InternalTextureSource.Unknown, true);
    internal._hardwareTexture = new WebGLHardwareTexture(handle as WebGLTexture, this.context);
    return internal;
  }

  refusal(): null {
    return null;
  }

  readonly readNow = (width: number, height: number): Float32Array => {
    const pixels = new Float32Array(4 * width * height);
    this.context.readPixels(0, 0, width, height, this.context.RGBA, this.context.FLOAT, pixels);
    return pixels;
  };

  read(): Promise<Float32Array> {
    throw new FieldError("WebGL answers at once.");
  }
}

class GpuDrawing implements Drawing {
  readonly device: TextureDevice;
  readonly depth: [number, number] = [1, 0];
  readonly readNow = null;

  constructor(private readonly engine: WebGPUEngine) {
    this.device = gpuDevice(engine._device);
  }

  shader(opened: Opened, example: Uniforms): ReturnType<Drawing["shader"]> {
    const data = new Data(example);
    const numbers = new Float32Array(4 * data.length);
    const list = `uniform u_list : array<vec4f, ${data.length}>;\n${data.source("uniforms.u_list")}\n`;
    const textures = Object.entries(textureTypes(opened)).map(([name, type]) => `var ${name} : ${type};\n`);
    const vertexSource = `${list}attribute position : vec3f;\n${CORNER}
@vertex fn main(input : VertexInputs) -> FragmentInputs {
  vertexOutputs.position = cornerInClip(vertexInputs.position);
}`;
    const fragmentSource = `${list}${textures.join("")}${wgslSource(opened)}
@fragment fn main(input : FragmentInputs) -> FragmentOutputs {
  let marched = marchRay(fragmentInputs.position.xy);
  fragmentOutputs.color = marched.color;
  fragmentOutputs.fragDepth = marched.depth;
}`;
    return {
      source: { vertexSource, fragmentSource },
      options: { shaderLanguage: ShaderLanguage.WGSL, uniforms: ["u_list"], samplers: Object.keys(textureTypes(opened)) },
      set: (effect, values) => {
        data.write(values, numbers);
        effect.setFloatArray4("u_list", numbers);
      },
    };
  }

  wrap({ handle, format, flat }: DeviceTexture): InternalTexture {
    const internal = this.engine.wrapWebGPUTexture(handle as GPUTexture);
    const hardware = internal._hardwareTexture as WebGPUHardwareTexture;
    hardware.createView({ format, dimension: flat ? "2d" : "3d", mipLevelCount: 1, baseArrayLayer: 0, baseMipLevel: 0, arrayLayerCount: 1, aspect: "all" });
    internal.samplingMode = Constants.TEXTURE_NEAREST_SAMPLINGMODE;
    // Babylon.js takes 32-bit floats for some that hardware may not interpolate, which these need not be.
    internal.type = format.endsWith("32float") ? Constants.TEXTURETYPE_FLOAT : Constants.TEXTURETYPE_HALF_FLOAT;
    return internal;
  }

  /** Depths can only be written to a target with a depth buffer. */
  refusal(): ReturnType<Drawing["refusal"]> {
    const target = this.engine._currentRenderTarget;
    const hasDepth = !target || target._generateDepthBuffer || target.depthStencilTexture;
    return hasDepth ? null : ["With WebGPU, a field is not drawn into a target without depth.", REMEDY.depth];
  }

  async read(texture: InternalTexture, width: number, height: number): Promise<Float32Array> {
    return (await this.engine._readTexturePixels(texture, width, height)) as Float32Array;
  }
}
