/** Recognizes files that are not containers by their first bytes, for helpful messages. */

import { FieldError, REMEDY } from "../errors.js";

const GLB = [0x67, 0x6c, 0x54, 0x46];

/** Kinds of files: their first bytes, and advice. */
const KINDS: readonly [string, readonly number[], string][] = [
  ["a binary glTF asset", GLB, REMEDY.asset],
  ["a PNG picture", [0x89, 0x50, 0x4e, 0x47], REMEDY.foreign],
  ["a JPEG picture", [0xff, 0xd8, 0xff], REMEDY.foreign],
  ["a PLY file of points, a mesh or splats", [0x70, 0x6c, 0x79], REMEDY.foreign],
  ["a ZIP archive, as models of PyTorch and NumPy are", [0x50, 0x4b, 0x03, 0x04], REMEDY.bake],
  ["a pickled model", [0x80, 0x02], REMEDY.bake],
  ["a NumPy array", [0x93, 0x4e, 0x55, 0x4d, 0x50, 0x59], REMEDY.bake],
  ["compressed by gzip", [0x1f, 0x8b], REMEDY.unpack],
  ["compressed by zstd", [0x28, 0xb5, 0x2f, 0xfd], REMEDY.unpack],
];
/** Place of the signature in a tar archive, such as an old PyTorch model. */
const [USTAR_AT, USTAR] = [257, [0x75, 0x73, 0x74, 0x61, 0x72]];

function has(bytes: Uint8Array, at: number, signature: readonly number[]): boolean {
  return signature.every((value, i) => bytes[at + i] === value);
}

/** The first letter of a text, after a byte order mark and spaces. */
function firstLetter(bytes: Uint8Array): string {
  return new TextDecoder().decode(bytes.subarray(0, 64)).trimStart().charAt(0);
}

/** Whether a file that starts with these bytes is a glTF asset, of either form. */
export function isAsset(bytes: Uint8Array): boolean {
  return has(bytes, 0, GLB) || firstLetter(bytes) === "{";
}

/** The error for a file that does not start like a container. */
export function foreign(bytes: Uint8Array): FieldError {
  const no = (what: string, remedy: string) => new FieldError(`This is no .mipvog container: it ${what}.`, remedy);
  const found = KINDS.find(([, signature]) => has(bytes, 0, signature));
  if (found) return no(`is ${found[0]}`, found[2]);
  if (has(bytes, USTAR_AT, USTAR)) return no("is a tar archive, as models of PyTorch and DirectVoxGO are", REMEDY.bake);
  const letter = firstLetter(bytes);
  if (letter === "<") return no("is a page", REMEDY.page);
  if (letter === "{" || letter === "[") return no("is JSON", REMEDY.json);
  return no("does not start with the signature", REMEDY.foreign);
}
