/** A page with the custom element. */

export { MipvogViewer } from "../../src/element.js";
