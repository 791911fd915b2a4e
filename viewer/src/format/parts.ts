/** Levels and shells, which are both parts, and the boxes that they span: section 6 of `formats/mipvog.md`, "Nested boxes". */

import type { Box, LevelMetadata, Metadata } from "./generated.js";

/** All that has a table and atlases: levels, and after them the shells of levels 1, 2 and so on. */
export function partsOf({ levels, shells = [] }: Metadata): LevelMetadata[] {
  return [...levels, ...shells];
}

/** Whether the field is a world: boxes lie around that of level 0. */
export function isNested({ shells }: Metadata): boolean {
  return shells !== undefined;
}

/** The level that a part belongs to. */
export function levelOfPart({ levels }: Metadata, part: number): number {
  return part < levels.length ? part : part - levels.length + 1;
}

/** The parts of a level in the order of a file: its shell, if it has one, and itself. */
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

/** For messages. */
export function partName(levels: number, part: number): string {
  return part < levels ? `level ${part}` : `the shell of level ${part - levels + 1}`;
}

/** The boxes, smallest first: that of level 0, and those of shells. */
export function boxesOf({ bounds, shells = [] }: Metadata): Box[] {
  return [bounds, ...shells.map((shell) => shell.bounds!)];
}

/** The box of everything. */
export function outerBounds(metadata: Metadata): Box {
  return metadata.shells?.at(-1)?.bounds ?? metadata.bounds;
}

/** The number of the box that a part spans: of a shell its own, of a level that of the next finer one. */
export function boxOfPart(metadata: Metadata, part: number): number {
  const { levels, shells = [] } = metadata;
  return part < levels.length ? Math.min(Math.max(part - 1, 0), shells.length) : levelOfPart(metadata, part);
}

/** The boxes in which samples read a part: a shell in its own, a level in that which it spans and all smaller ones. */
export function boxesReading(metadata: Metadata, part: number): number[] {
  const own = boxOfPart(metadata, part);
  return part < metadata.levels.length ? Array.from({ length: own + 1 }, (_, box) => box) : [own];
}

/** The part that shows a box at its finest. */
export function finestPart({ levels }: Metadata, box: number): number {
  return box === 0 ? 0 : levels.length + box - 1;
}

/** The level that a part's inherited blocks are made of; null where there is none of the same box. */
export function inheritedFrom(metadata: Metadata, part: number): number | null {
  const coarser = levelOfPart(metadata, part) + 1;
  return coarser < metadata.levels.length && boxOfPart(metadata, part) === boxOfPart(metadata, coarser) ? coarser : null;
}

/** Edges of a box. */
export function extentOf({ min, max }: Box): number[] {
  return min.map((low, axis) => max[axis] - low);
}
