/**
 * Everything in one script, including three.js and the decoders: the element and the classes, for pages without a
 * bundler.
 */

export * from "./element.js";
export * from "./index.js";
