/**
 * Decides which blocks are on the device if not all fit.
 *
 * The rank of a block is its node spacing divided by its distance from the camera, and half of that outside the
 * camera's view: blocks that look coarse come first. A block of the next coarser level at the same place has twice the
 * node spacing, is no farther away, and is visible wherever this one is. It therefore always ranks higher, and the next
 * coarser level replaces absent blocks wherever it fits at all.
 */

import type { Metadata, Triple } from "../format/metadata.js";
import { boxesOf, boxOfPart, extentOf, levelOfPart, partsOf } from "../format/parts.js";
import type { DecodedPart } from "./level.js";
import type { Plan } from "./plan.js";

/**
 * Position and direction of a camera in a field's axes. It sees everything within an angle of `forward`, which has
 * length 1; `cosine` is the cosine of the angle.
 */
export interface Look {
  place: readonly number[];
  forward: readonly number[];
  cosine: number;
}

/** Factor on the rank of a block outside the view. */
const UNSEEN = 0.5;
/**
 * A block keeps its slot against others of up to this many times its rank. Less than 2, to keep the order of levels and
 * of visible blocks.
 */
const LOYALTY = 1.1;
/** Resolution of ranks: steps per doubling, and number of doublings around 1. */
const [STEPS, DOUBLINGS] = [32, 40];
/** The block has no slot. */
const NONE = -1;

/** The state of one part. */
interface Part {
  places: readonly Triple[];
  /** Position of the part's first node, and its node spacing, in the field's axes. */
  start: number[];
  apart: number[];
  edge: number;
  /** Whether its blocks always have slots, as those of the coarsest level. */
  isBase: boolean;
  slots: Int32Array;
}

/** Blocks of a part that gained or lost slots. */
export interface Change {
  part: number;
  /** Blocks that gained a slot, in order. */
  gained: number[];
  hasLost: boolean;
}

export class Residents {
  private readonly parts = new Map<number, Part>();
  private readonly free: number[];
  /** The camera. Until it is known, at the centre of the innermost box, seeing everything. */
  private camera: Look;
  /** Smaller distances count as this. */
  private readonly nearest: number;

  constructor(
    private readonly metadata: Metadata,
    { slots: [x, y, z] }: Plan,
  ) {
    this.free = Array.from({ length: x * y * z }, (_, slot) => x * y * z - 1 - slot);
    const { min, max } = metadata.bounds;
    this.camera = { place: min.map((low, axis) => (low + max[axis]) / 2), forward: [1, 0, 0], cosine: -1 };
    this.nearest = Math.min(...extentOf(metadata.bounds).map((extent, axis) => extent / metadata.levels[0].dimensions[axis])) / 16;
  }

  /** Number of blocks with slots, and of all known blocks. */
  get count(): [number, number] {
    let [held, all] = [0, 0];
    for (const { slots } of this.parts.values()) {
      all += slots.length;
      for (const slot of slots) held += Number(slot !== NONE);
    }
    return [held, all];
  }

  /** Moves the camera. */
  look(camera: Look): void {
    this.camera = camera;
  }

  /** Adds a part, with its stored blocks in order. */
  add(number: number, places: readonly Triple[]): void {
    if (this.parts.has(number)) return;
    const stored = partsOf(this.metadata)[number];
    const box = boxesOf(this.metadata)[boxOfPart(this.metadata, number)];
    this.parts.set(number, {
      places,
      start: box.min,
      apart: extentOf(box).map((extent, axis) => extent / (stored.dimensions[axis] - 1)),
      edge: stored.block_size,
      isBase: levelOfPart(this.metadata, number) === this.metadata.levels.length - 1,
      slots: new Int32Array(places.length).fill(NONE),
    });
  }

  /** The slot of a block; null without one. */
  slotOf(part: number, block: number): number | null {
    const slot = this.parts.get(part)?.slots[block] ?? NONE;
    return slot === NONE ? null : slot;
  }

  /** Gives slots to the blocks of the highest ranks. Returns the changes, coarse to fine. */
  settle(): Change[] {
    const ranks = [...this.parts].map(([number, part]) => ({ number, part, steps: this.stepsOf(part) }));
    const counts = new Uint32Array(2 * DOUBLINGS * STEPS + 1);
    for (const { steps } of ranks) for (const step of steps) counts[step]++;
    const room = this.free.length + this.count[0];
    let [least, left] = [counts.length, room];
    while (least > 0 && counts[least - 1] <= left) left -= counts[--least];
    // Of the next step, as many as there is room for; those that have slots first.
    const isNext = (part: Part, steps: Uint16Array, block: number, holds: boolean) => left > 0 && steps[block] === least - 1 && holds === (part.slots[block] !== NONE);
    const wanted = ranks.map(({ part, steps }) => Uint8Array.from(part.slots, (_, block) => {
      const isIn = steps[block] >= least || isNext(part, steps, block, true);
      if (isIn && steps[block] < least) left--;
      return Number(isIn);
    }));
    ranks.forEach(({ part, steps }, i) => {
      for (let block = 0; left > 0 && block < steps.length; block++) {
        if (!isNext(part, steps, block, false)) continue;
        wanted[i][block] = 1;
        left--;
      }
    });
    const changes = ranks.map(({ number, part }, i): Change => {
      let hasLost = false;
      for (let block = 0; block < part.slots.length; block++) {
        if (wanted[i][block] || part.slots[block] === NONE) continue;
        this.free.push(part.slots[block]);
        part.slots[block] = NONE;
        hasLost = true;
      }
      return { part: number, gained: [], hasLost };
    });
    ranks.forEach(({ part }, i) => {
      for (let block = 0; block < part.slots.length; block++) {
        if (!wanted[i][block] || part.slots[block] !== NONE) continue;
        part.slots[block] = this.free.pop()!;
        changes[i].gained.push(block);
      }
    });
    return changes.filter(({ gained, hasLost }) => hasLost || gained.length > 0);
  }

  /** The ranks of a part's blocks, in steps. */
  private stepsOf({ places, start, apart, edge, isBase, slots }: Part): Uint16Array {
    const most = 2 * DOUBLINGS * STEPS;
    const { place: camera, forward, cosine } = this.camera;
    const size = Math.max(...apart);
    const radius = 0.5 * edge * Math.hypot(...apart);
    const angle = Math.acos(cosine);
    const isSeen = (middle: number[]) => {
      const distance = Math.hypot(...middle);
      if (distance <= radius || cosine <= -1) return true;
      const along = middle.reduce((sum, value, axis) => sum + value * forward[axis], 0) / distance;
      return Math.acos(Math.min(1, Math.max(-1, along))) - Math.asin(radius / distance) <= angle;
    };
    return Uint16Array.from(places, (place, block) => {
      if (isBase) return most;
      let square = 0;
      const middle = [0, 0, 0];
      for (let axis = 0; axis < 3; axis++) {
        const low = start[axis] + place[axis] * edge * apart[axis];
        const aside = Math.max(low - camera[axis], 0, camera[axis] - low - edge * apart[axis]);
        square += aside * aside;
        middle[axis] = low + 0.5 * edge * apart[axis] - camera[axis];
      }
      const worth = (slots[block] === NONE ? 1 : LOYALTY) * (isSeen(middle) ? 1 : UNSEEN);
      const doublings = Math.log2((size * worth) / Math.max(Math.sqrt(square), this.nearest));
      return Math.round(Math.min(Math.max(doublings + DOUBLINGS, 0) * STEPS, most - 1));
    });
  }
}

/** The bricks of those blocks of a decoded part that have slots; null if none has. */
export function resident(part: DecodedPart, { quads, directionalQuads }: Plan, slotOf: (block: number) => number | null): DecodedPart | null {
  const found: [number, number][] = [];
  for (let block = 0; block < part.blocks; block++) {
    const slot = slotOf(part.first + block);
    if (slot !== null) found.push([block, slot]);
  }
  if (found.length === 0) return null;
  const nodes = part.side ** 3;
  const picked = <T extends Uint8Array | Uint16Array | Float32Array>(bricks: T, rows: number, size: number): T => {
    const out = new (bricks.constructor as new (length: number) => T)(rows * found.length * size);
    for (let row = 0; row < rows; row++) {
      found.forEach(([block], i) => {
        const at = (row * part.blocks + block) * size;
        out.set(bricks.subarray(at, at + size), (row * found.length + i) * size);
      });
    }
    return out;
  };
  return {
    ...part,
    blocks: found.length,
    density: part.density && picked(part.density, 1, nodes),
    color: picked(part.color, quads, 4 * nodes),
    directional: part.directional && picked(part.directional, directionalQuads, 4 * nodes),
    slots: Uint32Array.from(found, ([, slot]) => slot),
  };
}

/**
 * Runs of consecutive blocks that contain all of `blocks`, which are in ascending order. Gaps of up to `gap` blocks are
 * bridged.
 */
export function runsOf(blocks: readonly number[], gap: number): [number, number][] {
  const runs: [number, number][] = [];
  for (const block of blocks) {
    const last = runs.at(-1);
    if (last && block - last[1] <= gap) last[1] = block + 1;
    else runs.push([block, block + 1]);
  }
  return runs;
}
