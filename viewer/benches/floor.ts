/** How fast a device is at what a fragment shader does most; runs in a page. */

/** Of fragment shaders: multiplications with additions, and filtered texels of four halves from a volume, in billions a second. */
export interface Floor {
  arithmetic: number;
  texels: number;
}

/** Draws pictures that do nothing else. Stands on nothing outside, because it is sent to the page as text. */
export function measureFloor(): Floor {
  const [side, volume, repeats] = [1024, 64, 8];
  const gl = new OffscreenCanvas(side, side).getContext("webgl2")!;
  const program = (body: string) => {
    const made = gl.createProgram()!;
    const vertex = "#version 300 es\nvoid main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }";
    const head = "#version 300 es\nprecision highp float; precision highp sampler3D; uniform sampler3D u_volume; uniform vec4 u_some; out vec4 color;\n";
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, `${head}void main() { ${body} }`],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  };
  gl.bindTexture(gl.TEXTURE_3D, gl.createTexture());
  gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGBA16F, volume, volume, volume);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, gl.LINEAR);
  /** Billions a second of what a fragment does `count` times, four at a time. */
  const speed = (body: string, count: number) => {
    gl.useProgram(program(body));
    gl.uniform4f(gl.getUniformLocation(gl.getParameter(gl.CURRENT_PROGRAM) as WebGLProgram, "u_some"), 0.999, 0.001, 0.998, 0.002);
    const draw = (times: number) => {
      const start = performance.now();
      for (let i = 0; i < times; i++) gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      return performance.now() - start;
    };
    draw(1);
    return (count * side * side * repeats) / draw(repeats) / 1e6;
  };
  const rounds = 64;
  const chains = "a = a * u_some + b; b = b * u_some + c; c = c * u_some + d; d = d * u_some + a;";
  const arithmetic = `vec4 a = gl_FragCoord, b = a.yzwx, c = a.zwxy, d = a.wxyz; for (int i = 0; i < ${rounds}; i++) { ${chains} } color = a + b + c + d;`;
  const place = `vec3(gl_FragCoord.xy / ${side}.0, float(i) / ${rounds}.0 + u_some.x)`;
  const texels = `vec4 sum = vec4(0.0); for (int i = 0; i < ${rounds}; i++) sum += textureLod(u_volume, ${place}, 0.0); color = sum;`;
  return { arithmetic: speed(arithmetic, 16 * rounds), texels: speed(texels, rounds) };
}
