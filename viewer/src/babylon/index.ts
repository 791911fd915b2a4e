/** The adapter for Babylon.js. Importing it adds fields to the glTF loader. */

import { registerGLTFExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js";
import { EXTENSION } from "../asset.js";
import { RadianceFieldExtension } from "./gltf.js";

registerGLTFExtension(EXTENSION, true, (loader) => new RadianceFieldExtension(loader));

export { EXTENSION } from "../asset.js";
export { startDecodersBy } from "../decoder.js";
export { FieldError } from "../errors.js";
export type { Metadata } from "../format/metadata.js";
export type { Source, Transfer } from "../load/source.js";
export type { Statistics } from "../render/measures.js";
export type { Budget, FieldEvents, FieldOptions } from "../fieldOptions.js";
export { RadianceField } from "./field.js";
export { RadianceFieldExtension } from "./gltf.js";
