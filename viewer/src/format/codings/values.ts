/** From codes to values: section 5 of `formats/mipvog.md`. */

import { FieldError } from "../../errors.js";
import type { Encoding } from "../metadata.js";

const bits32 = new Uint32Array(1);
const float32 = new Float32Array(bits32.buffer);

/** The value of a code. */
export type Value = (code: number) => number;

/** Values of codes after `map`. For narrow codes, `map` is applied once per code; for wide ones, at every node. */
export function values(encoding: Encoding, name: string, map: Value): Value {
  if (encoding.number === "f32") {
    return (code) => {
      // Ordered bits: the sign's bit set and cleared, or all flipped.
      bits32[0] = code & 0x80000000 ? code & 0x7fffffff : ~code;
      return map(float32[0]);
    };
  }
  const table = valueTable(encoding, name, map)!;
  return (code) => table[code];
}

/** Values of integer codes and half floats after `map`, by code. Null for 32-bit floats, which have too many codes. */
export function valueTable(encoding: Encoding, name: string, map: Value): Float64Array | null {
  if (encoding.number === "f32") return null;
  return encoding.number === "f16" ? halfTable(map) : integerTable(encoding, name, map);
}

function integerTable(encoding: Encoding, name: string, map: Value): Float64Array {
  const { fround } = Math;
  const [center, step, curve, empty] = [encoding.center, encoding.step, encoding.curve, encoding.empty].map(fround);
  const middle = 2 ** (encoding.bits - 1);
  let before = -Infinity;
  return Float64Array.from({ length: 2 ** encoding.bits }, (_, code) => {
    const x = code - middle;
    // Rounded to f32 after every operation, as the specification says.
    const own = fround(center + fround(x * fround(step + fround(curve * fround(x * x)))));
    const value = encoding.empty_code && code === 0 ? empty : own;
    if (!Number.isFinite(value) || value <= before) throw new FieldError(`${name}: the values of codes do not ascend.`);
    before = value;
    return map(value);
  });
}

function halfTable(map: Value): Float64Array {
  return Float64Array.from({ length: 65536 }, (_, code) => {
    const bits = code & 0x8000 ? code & 0x7fff : ~code & 0xffff;
    return map(halfValue(bits));
  });
}

/** The number represented by binary16 bits. */
function halfValue(bits: number): number {
  const [exponent, fraction] = [(bits >> 10) & 31, bits & 1023];
  const size = exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25);
  return bits & 0x8000 ? -size : size;
}

/** The binary16 bits nearest to a number, ties to even; beyond the range, the largest finite number. */
export function toHalf(value: number): number {
  float32[0] = Math.max(-65504, Math.min(65504, value));
  const bits = bits32[0];
  const sign = (bits >>> 16) & 0x8000;
  const size = bits & 0x7fffffff;
  if (size < 0x38800000) return sign | roundEven(Math.abs(float32[0]) * 2 ** 24);
  // The exponent loses its offset of 127 - 15; the fraction 13 bits, rounded to even.
  return sign | ((size - 0x38000000 + 0x0fff + ((size >>> 13) & 1)) >>> 13);
}

function roundEven(value: number): number {
  const low = Math.floor(value);
  const rest = value - low;
  return rest > 0.5 || (rest === 0.5 && low % 2 === 1) ? low + 1 : low;
}
