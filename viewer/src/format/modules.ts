/**
 * WebAssembly modules for code that is slow in JavaScript. Each has a JavaScript version, for pages that do not allow
 * WebAssembly.
 */

/** Start of free memory; lower addresses belong to the module itself. */
const FREE = 1 << 16;
const PAGE = 1 << 16;
/** Bytes per vector; addresses are multiples of this. */
export const VECTOR = 16;

/** The exports of a module; null if the page or the device does not allow it. */
export async function instance<Exports>(module: BufferSource): Promise<Exports | null> {
  try {
    return (await WebAssembly.instantiate(module)).instance.exports as Exports;
  } catch {
    return null;
  }
}

/** Allocates areas of the given sizes in a module's memory, which grows if necessary. Earlier contents are lost. */
export function places<Name extends string>(memory: WebAssembly.Memory, bytes: Record<Name, number>): Record<Name, number> {
  let end = FREE;
  const starts = {} as Record<Name, number>;
  for (const name in bytes) {
    starts[name] = end;
    end = Math.ceil((end + bytes[name]) / VECTOR) * VECTOR;
  }
  const missing = end - memory.buffer.byteLength;
  if (missing > 0) memory.grow(Math.ceil(missing / PAGE));
  return starts;
}
