/** As `index.ts`, for scenes that three.js's WebGPURenderer draws, too. */

import { useGpuDrawing } from "./three/drawing.js";
import { nodeDrawing } from "./three/nodes.js";

useGpuDrawing(nodeDrawing);

export * from "./index.js";
