/** Shaders are bundled as text. */
declare module "*.glsl" {
  const source: string;
  export default source;
}

/** WebAssembly is bundled as bytes. */
declare module "*.wasm" {
  const bytes: Uint8Array<ArrayBuffer>;
  export default bytes;
}

/** The worker is bundled as text, too. */
declare module "*.txt" {
  const text: string;
  export default text;
}
