/** What `<mipvog-viewer>` is made of: its style and its attributes. */

export const STYLE = `
:host { display: block; position: relative; width: 100%; aspect-ratio: 3 / 2; overflow: hidden; }
:host([hidden]) { display: none; }
canvas, img { position: absolute; inset: 0; width: 100%; height: 100%; }
img { object-fit: cover; pointer-events: none; }
[hidden] { display: none; }
p { position: absolute; inset: auto 0 0; margin: 0; padding: 0.5em; color: #fff; background: #000c; }
p button { font: inherit; }
::slotted([data-position]) { position: absolute; left: 0; top: 0; }
`;

/** Attributes that are properties of the same value; boolean attributes; all others. */
export const TEXTS = ["src", "background", "alt", "poster"] as const;
export const ATTRIBUTES = [...TEXTS, "camera", "auto-rotate", "disable-zoom", "disable-pan", "distance-limits", "elevation-limits", "touch-action", "max-bytes"] as const;

/** The text alternative of pictures without `alt`. */
export const UNNAMED = "A radiance field";

/** Two numbers of an attribute, the smaller one first; null if it has anything else. */
export function pair(text: string | null): [number, number] | null {
  const values = (text ?? "").trim().split(/[\s,]+/).map(Number);
  return values.length === 2 && values.every(Number.isFinite) && values[0] <= values[1] ? [values[0], values[1]] : null;
}
