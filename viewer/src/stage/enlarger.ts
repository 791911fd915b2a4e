/** Enlarges a small picture to the whole canvas. */

const VERTEX = `#version 300 es
out vec2 place;

// A triangle that covers the picture.
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  place = 2.0 * corner;
  gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}
`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D picture;
in vec2 place;
layout(location = 0) out vec4 color;

void main() {
  color = texture(picture, place);
}
`;

/**
 * Draws the enlarged picture. The copy and stretch of the device would run on one core in software renderers, with code
 * that is slow to compile. Nothing is read back, which would block the page.
 */
export class Enlarger {
  private program: WebGLProgram | null = null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    ended: AbortSignal,
  ) {
    gl.canvas.addEventListener("webglcontextlost", () => (this.program = null), { signal: ended });
    ended.addEventListener("abort", () => gl.deleteProgram(this.program));
  }

  /**
   * Enlarges the picture of `width` by `height` pixels in the lower left corner of the canvas. Changes the state of the
   * context.
   */
  spread(width: number, height: number, size: readonly [number, number]): void {
    const { gl } = this;
    gl.useProgram((this.program ??= this.build()));
    // What is drawn into the canvas cannot come from it.
    const texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.bindSampler(0, null);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.copyTexImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 0, 0, width, height, 0);
    for (const name of [gl.BLEND, gl.DEPTH_TEST, gl.CULL_FACE, gl.SCISSOR_TEST, gl.STENCIL_TEST]) gl.disable(name);
    gl.colorMask(true, true, true, true);
    gl.viewport(0, 0, ...size);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.deleteTexture(texture);
  }

  private build(): WebGLProgram {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
      const shader = gl.createShader(type)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      // It goes with the program.
      gl.deleteShader(shader);
    }
    gl.linkProgram(program);
    return program;
  }
}
