import React, { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { Canvas, extend } from "@react-three/fiber";
import { RadianceField } from "mipvog-viewer";

extend({ RadianceField });

createRoot(document.getElementById("root")).render(
  <StrictMode>
    <Canvas flat camera={{ position: [4, 2, 0], fov: 40 }}>
      <radianceField args={["scene.mipvog"]} rotation-x={-Math.PI / 2} />
    </Canvas>
  </StrictMode>,
);
