import "mipvog-viewer/element";

document.querySelector("mipvog-viewer").addEventListener("error", ({ detail }) => console.error(detail.message));
