/** Parts, which are levels and shells, and their boxes: section 6 of `formats/mipvog.md`, "Nested boxes". */

import type { Box, LevelMetadata, Metadata } from "./generated.js";

/** All parts: the levels, then the shells of levels 1, 2 and so on. Each has a table and atlases. */
export function partsOf({ levels, shells = [] }: Metadata): LevelMetadata[] {
  return [...levels, ...shells];
}

/** Whether the field is a world: boxes surround that of level 0. */
export function isNested({ shells }: Metadata): boolean {
  return shells !== undefined;
}

/** The level that a part belongs to. */
export function levelOfPart({ levels }: Metadata, part: number): number {
  return part < levels.length ? part : part - levels.length + 1;
}

/** The parts of a level in file order: its shell, if any, then the level itself. */
export function partsOfLevel({ levels, shells = [] }: Metadata, level: number): number[] {
  return level > 0 && level <= shells.length ? [levels.length + level - 1, level] : [level];
}

/** The parts from a level on, coarse to fine, as in a file. */
export function partsFrom(metadata: Metadata, finest: number): number[] {
  return metadata.levels.flatMap((_, i) => {
    const level = metadata.levels.length - 1 - i;
    return level < finest ? [] : partsOfLevel(metadata, level);
  });
}

/** The name of a part, for messages. */
export function partName(levels: number, part: number): string {
  return part < levels ? `level ${part}` : `the shell of level ${part - levels + 1}`;
}

/** The boxes, smallest first: that of level 0, then those of the shells. */
export function boxesOf({ bounds, shells = [] }: Metadata): Box[] {
  return [bounds, ...shells.map((shell) => shell.bounds!)];
}

/** The outermost box. */
export function outerBounds(metadata: Metadata): Box {
  return metadata.shells?.at(-1)?.bounds ?? metadata.bounds;
}

/** Index of the box of a part: for a shell its own, for a level that of the next finer level. */
export function boxOfPart(metadata: Metadata, part: number): number {
  const { levels, shells = [] } = metadata;
  return part < levels.length ? Math.min(Math.max(part - 1, 0), shells.length) : levelOfPart(metadata, part);
}

/** The boxes in which samples read a part: for a shell its own, for a level its box and all smaller ones. */
export function boxesReading(metadata: Metadata, part: number): number[] {
  const own = boxOfPart(metadata, part);
  return part < metadata.levels.length ? Array.from({ length: own + 1 }, (_, box) => box) : [own];
}

/** The part that shows a box at its finest. */
export function finestPart({ levels }: Metadata, box: number): number {
  return box === 0 ? 0 : levels.length + box - 1;
}

/** The level that a part's inherited blocks come from; null if no level has the same box. */
export function inheritedFrom(metadata: Metadata, part: number): number | null {
  const coarser = levelOfPart(metadata, part) + 1;
  return coarser < metadata.levels.length && boxOfPart(metadata, part) === boxOfPart(metadata, coarser) ? coarser : null;
}

/** Lengths of the edges of a box. */
export function extentOf({ min, max }: Box): number[] {
  return min.map((low, axis) => max[axis] - low);
}
