"use client"; // app/page.jsx; scene.mipvog lies in public/
import { useEffect } from "react";

export default function Page() {
  // The element's script is for browsers; the server writes its tag.
  useEffect(() => void import("mipvog-viewer/element"), []);
  return <mipvog-viewer src="scene.mipvog" alt="A toy digger" />;
}
