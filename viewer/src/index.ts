export { EXTENSION } from "./asset.js";
export { startDecodersBy } from "./decoder.js";
export { FieldError } from "./errors.js";
export { RadianceField, type RadianceFieldEventMap } from "./three/field.js";
export type { Metadata } from "./format/metadata.js";
export type { Statistics } from "./render/measures.js";
export { RadianceFieldExtension } from "./three/gltf.js";
export type { Source, Transfer } from "./load/source.js";
export type { Budget, FieldOptions } from "./fieldOptions.js";
