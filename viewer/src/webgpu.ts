/** As `index.ts`, also for scenes drawn by three.js's WebGPURenderer. */

import { useGpuDrawing } from "./three/drawing.js";
import { nodeDrawing } from "./three/nodes.js";

useGpuDrawing(nodeDrawing);

export * from "./index.js";
