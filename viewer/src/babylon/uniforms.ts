/** Sets the uniforms of the current program by their declared types. */

import type { Uniforms } from "../render/uniforms.js";

type Setter = (gl: WebGL2RenderingContext, at: WebGLUniformLocation, values: number[]) => void;

const integers = (size: 1 | 2 | 3 | 4): Setter => (gl, at, values) => gl[`uniform${size}iv`](at, values);
const floats = (size: 1 | 2 | 3 | 4): Setter => (gl, at, values) => gl[`uniform${size}fv`](at, values);

/** Setters, by the type numbers of WebGL 2. */
const SETTERS: Record<number, Setter> = {
  0x1404: integers(1), // INT
  0x8b54: integers(3), // INT_VEC3
  0x8b55: integers(4), // INT_VEC4
  0x8b56: integers(1), // BOOL
  0x1406: floats(1), // FLOAT
  0x8b50: floats(2), // FLOAT_VEC2
  0x8b51: floats(3), // FLOAT_VEC3
  0x8b52: floats(4), // FLOAT_VEC4
  0x8b5b: (gl, at, values) => gl.uniformMatrix3fv(at, false, values), // FLOAT_MAT3
  0x8b5c: (gl, at, values) => gl.uniformMatrix4fv(at, false, values), // FLOAT_MAT4
};

/** The uniforms of each program, without its samplers. */
const declared = new WeakMap<WebGLProgram, [string, WebGLUniformLocation, Setter][]>();

function declaredBy(gl: WebGL2RenderingContext, program: WebGLProgram): [string, WebGLUniformLocation, Setter][] {
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) as number;
  const all = Array.from({ length: count }, (_, number) => gl.getActiveUniform(program, number)!);
  return all.flatMap(({ name, type }) => {
    const location = gl.getUniformLocation(program, name);
    // An array goes by the name of its first element.
    return location && SETTERS[type] ? [[name.replace("[0]", ""), location, SETTERS[type]]] : [];
  });
}

export function setUniforms(gl: WebGL2RenderingContext, values: Uniforms): void {
  const program = gl.getParameter(gl.CURRENT_PROGRAM) as WebGLProgram;
  let uniforms = declared.get(program);
  if (!uniforms) declared.set(program, (uniforms = declaredBy(gl, program)));
  for (const [name, location, set] of uniforms) {
    const value = values[name];
    if (value !== undefined) set(gl, location, Array.isArray(value) ? value : [Number(value)]);
  }
}
