export { EXTENSION } from "./asset.js";
export { startDecodersBy } from "./decoder.js";
export { FieldError } from "./errors.js";
export { RadianceField, type RadianceFieldEventMap, type Statistics } from "./three/field.js";
export type { Metadata } from "./format/metadata.js";
export { RadianceFieldExtension } from "./three/gltf.js";
export type { Source, Transfer } from "./load/source.js";
