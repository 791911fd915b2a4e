/** Modules of WebAssembly: what is slow in plain script. Each has a plain form, for pages that may not run it. */

/** Where memory is free: what is below is the module's own. */
const FREE = 1 << 16;
const PAGE = 1 << 16;
/** Bytes of a vector, at whose multiples places start. */
export const VECTOR = 16;

/** What a module exports; null where the page or the device does not allow it. */
export async function instance<Exports>(module: BufferSource): Promise<Exports | null> {
  try {
    return (await WebAssembly.instantiate(module)).instance.exports as Exports;
  } catch {
    return null;
  }
}

/** Places of so many bytes each in a module's memory, which grows where they need it. What was there before is lost. */
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
