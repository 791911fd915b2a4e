/**
 * Empty space that rays skip.
 *
 * The box is divided into macro cells of a few level-0 cells per side. A macro cell is occupied by a level if a sample
 * of that level can be visible in it. For each level, a macro cell has a skip distance: the Chebyshev distance to the
 * nearest occupied one, which a ray skips at once. `sample/skip.rs` of the reference renderer does the same. Each
 * nested box has macro cells of its own.
 */

import { blockCounts, type Metadata, type Triple } from "../format/metadata.js";
import { boxesOf, boxOfPart, extentOf, finestPart, isNested, partsOf } from "../format/parts.js";
import { invisibleDensity } from "./interpolated.js";
import { sweepLanes } from "./sweeps.js";
import { storedCodes } from "./texels.js";

/** Level-0 cells along each edge of a macro cell, in a box with few of them. */
const LEAST_EDGE = 2;
/** Maximum number of macro cells along an axis; and with several boxes, whose cells share memory. */
const [MOST_CELLS, MOST_NESTED] = [128, 64];

/** Nodes of a box at its finest. */
export function boxNodes(metadata: Metadata, box: number): Triple {
  return partsOf(metadata)[finestPart(metadata, box)].dimensions;
}

/** Maximum bytes of skip distances as a share of all codes; and how much larger macro cells may become to meet it. */
const [MOST_SHARE, MOST_LARGER] = [0.25, 8];

/** Number of finest cells of a box along each edge of a macro cell, if macro cells are `larger` than usual. */
function edgeOf(metadata: Metadata, box: number, larger: number): number {
  const most = Math.max(...boxNodes(metadata, box)) - 1;
  return larger * Math.max(LEAST_EDGE, Math.ceil(most / (isNested(metadata) ? MOST_NESTED : MOST_CELLS)));
}

function countsOf(metadata: Metadata, box: number, larger: number): Triple {
  return boxNodes(metadata, box).map((nodes) => Math.ceil((nodes - 1) / edgeOf(metadata, box, larger))) as Triple;
}

/** Number of boxes whose macro cells are side by side along the field's y; further boxes are in rows along its z. */
export const BOXES_BESIDE = 16;

/** Room for the macro cells of any box, and the sides of the texture with all of them. */
function roomOf(metadata: Metadata, larger: number): { room: Triple; sides: Triple } {
  const counts = boxesOf(metadata).map((_, box) => countsOf(metadata, box, larger));
  const room = [0, 1, 2].map((axis) => Math.max(...counts.map((count) => count[axis]))) as Triple;
  const [x, y, z] = room;
  const sides: Triple = [z * Math.ceil(counts.length / BOXES_BESIDE), y * Math.min(counts.length, BOXES_BESIDE), x * Math.ceil(metadata.levels.length / 4)];
  return { room, sides };
}

/**
 * Factor by which macro cells are larger: worlds of many boxes and few blocks would otherwise consist mostly of macro
 * cells.
 */
function largerBy(metadata: Metadata): number {
  let larger = 1;
  for (; larger < MOST_LARGER; larger *= 2) {
    const [x, y, z] = roomOf(metadata, larger).sides;
    if (4 * x * y * z <= MOST_SHARE * storedCodes(metadata)) break;
  }
  return larger;
}

/** Number of finest cells of a box along each edge of a macro cell. */
export function macroEdge(metadata: Metadata, box: number): number {
  return edgeOf(metadata, box, largerBy(metadata));
}

/** Number of macro cells of a box along each axis. */
export function macroCounts(metadata: Metadata, box: number): Triple {
  return countsOf(metadata, box, largerBy(metadata));
}

/** Room for the macro cells of any box along the field's axes; along x, for a quadruple of levels. */
export function macroRoom(metadata: Metadata): Triple {
  return roomOf(metadata, largerBy(metadata)).room;
}

/** Sides of the texture of skip distances, with four bytes per texel. Its x is the field's z. */
export function macroSides(metadata: Metadata): Triple {
  return roomOf(metadata, largerBy(metadata)).sides;
}

/** Share of the occupied macro cells along an axis that may be outliers, at each end. */
const STRAY = 0.005;

/** Two corners, as fractions of the box, between which nearly all occupied macro cells lie. */
export function occupiedShares(skipDistances: Uint8Array, counts: Triple): [number[], number[]] {
  const [nx, ny, nz] = counts;
  const along = counts.map((count) => new Float64Array(count));
  let sum = 0;
  for (let x = 0, cell = 0; x < nx; x++) {
    for (let y = 0; y < ny; y++) {
      for (let z = 0; z < nz; z++) {
        if (skipDistances[cell++] > 0) continue;
        sum++;
        along[0][x]++;
        along[1][y]++;
        along[2][z]++;
      }
    }
  }
  if (sum === 0) return [[0, 0, 0], [1, 1, 1]];
  /** The first cell after the outliers. */
  const start = (cells: Float64Array) => {
    let passed = 0;
    return cells.findIndex((count) => (passed += count) > STRAY * sum);
  };
  return [along.map((cells, axis) => start(cells) / counts[axis]), along.map((cells, axis) => 1 - start(cells.slice().reverse()) / counts[axis])];
}

/**
 * The centre of the cell farthest from all occupied cells and from the faces of the box, as fractions of the box, if it
 * is at least `least` cells away.
 */
export function freePlace(skipDistances: Uint8Array, counts: Triple, least: number): number[] | null {
  const [nx, ny, nz] = counts;
  const toFace = (at: number, count: number) => Math.min(at, count - 1 - at) + 1;
  let best: { free: number; aside: number; place: number[] } | null = null;
  for (let x = 0, cell = 0; x < nx; x++) {
    for (let y = 0; y < ny; y++) {
      for (let z = 0; z < nz; z++) {
        const known = skipDistances[cell++];
        if (known < least || (best && known < best.free)) continue;
        const free = Math.min(known, toFace(x, nx), toFace(y, ny), toFace(z, nz));
        if (free < least || (best && free < best.free)) continue;
        const place = [x, y, z].map((at, axis) => (at + 0.5) / counts[axis]);
        // Of several, the one nearest to the middle.
        const aside = Math.hypot(...place.map((share) => share - 0.5));
        if (!best || free > best.free || aside < best.aside) best = { free, aside, place };
      }
    }
  }
  return best && best.place;
}

/** A group of cells along an axis, and the first and last node of a block at their corners. */
interface Nodes {
  group: number;
  first: number;
  last: number;
}

/** The macro cells of one level or shell. */
export class MacroCells {
  /** Groups of `edge` cells of the part per side: 1 if a corner of one of them can be visible. */
  readonly marks: Uint8Array;
  private readonly edge: number;
  private readonly nodes: Triple;
  private readonly block: number;
  /** The largest invisible density. */
  readonly limit: number;
  /** For each axis and each block position along it, the result of `groups`. */
  private readonly along: readonly Nodes[][][];

  constructor(
    private readonly metadata: Metadata,
    private readonly part: number,
  ) {
    const stored = partsOf(metadata)[part];
    this.edge = macroEdge(metadata, boxOfPart(metadata, part));
    this.nodes = stored.dimensions;
    this.block = stored.block_size;
    this.marks = new Uint8Array(this.groupCounts().reduce((product, count) => product * count, 1));
    this.along = blockCounts(stored).map((count, axis) => Array.from({ length: count }, (_, place) => this.groups(place, axis)));
    this.limit = invisibleDensity(metadata.activation, stored.density?.decode ?? "raw_density");
  }

  /** Skip distances of the part in a box, from the `marks` set by all of its blocks. */
  skipDistances(marks: Uint8Array, box: number): Uint8Array {
    const counts = macroCounts(this.metadata, box);
    const [nx, ny, nz] = counts;
    const skipDistances = new Uint8Array(nx * ny * nz).fill(255);
    this.clear(marks, skipDistances, box);
    if (!sweepLanes(skipDistances, counts)) sweepBoth(skipDistances, counts);
    return skipDistances;
  }

  /**
   * Marks the groups in which a corner of a cell can be visible. `bricks` mark such nodes, for the blocks at `places`
   * and their aprons.
   */
  mark(bricks: Uint8Array, places: Triple[]): void {
    const { marks } = this;
    const [, gy, gz] = this.groupCounts();
    const side = this.block + 1;
    const [alongX, alongY, alongZ] = this.along;
    for (let block = 0; block < places.length; block++) {
      const place = places[block];
      const [xs, ys, zs] = [alongX[place[0]], alongY[place[1]], alongZ[place[2]]];
      for (const x of xs) {
        for (const y of ys) {
          for (const z of zs) {
            const group = (x.group * gy + y.group) * gz + z.group;
            if (marks[group] === 0 && this.canBeSeen(bricks, block * side * side * side, x, y, z)) marks[group] = 1;
          }
        }
      }
    }
  }

  /** Whether a node of a box in a brick can be visible. In most boxes, one of the first nodes decides. */
  private canBeSeen(bricks: Uint8Array, brick: number, xs: Nodes, ys: Nodes, zs: Nodes): boolean {
    const side = this.block + 1;
    for (let x = xs.first; x <= xs.last; x++) {
      for (let y = ys.first; y <= ys.last; y++) {
        const row = brick + (x * side + y) * side;
        for (let node = row + zs.first; node <= row + zs.last; node++) if (bricks[node] === 1) return true;
      }
    }
    return false;
  }

  /**
   * The groups along an axis of the cells whose lowest nodes are in a block, and the corners of these cells. The last
   * node of an axis is no cell's lowest.
   */
  private groups(place: number, axis: number): Nodes[] {
    const { edge, block } = this;
    const first = place * block;
    const end = Math.min(first + block, this.nodes[axis] - 1);
    const groups: Nodes[] = [];
    for (let group = Math.floor(first / edge); group * edge < end; group++) {
      groups.push({ group, first: Math.max(group * edge, first) - first, last: Math.min((group + 1) * edge, end) - first });
    }
    return groups;
  }

  private groupCounts(): Triple {
    return this.nodes.map((nodes) => Math.ceil(nodes / this.edge)) as Triple;
  }

  /** Writes 0 to the macro cells of a box that marked groups overlap. */
  private clear(groups: Uint8Array, skipDistances: Uint8Array, box: number): void {
    const counts = macroCounts(this.metadata, box);
    const [, ny, nz] = counts;
    const [alongX, alongY, alongZ] = this.groupCounts().map((count, axis) => {
      const place = this.placeIn(box, axis);
      return Array.from({ length: count }, (_, group) => this.overlap(axis, group, place, counts[axis]));
    });
    let group = 0;
    for (const xs of alongX) {
      for (const ys of alongY) {
        for (const zs of alongZ) {
          if (groups[group++] === 0) continue;
          for (let x = xs[0]; x < xs[1]; x++) {
            for (let y = ys[0]; y < ys[1]; y++) {
              const row = (x * ny + y) * nz;
              for (let cell = row + zs[0]; cell < row + zs[1]; cell++) skipDistances[cell] = 0;
            }
          }
        }
      }
    }
  }

  /** The position of the part's first node along an axis and its node spacing, in macro cells of a box. */
  private placeIn(box: number, axis: number): [number, number] {
    const { metadata } = this;
    const [all, own] = [boxesOf(metadata), boxOfPart(metadata, this.part)];
    const cells = (boxNodes(metadata, box)[axis] - 1) / macroEdge(metadata, box);
    const nodes = this.nodes[axis] - 1;
    if (box === own) return [0, cells / nodes];
    const scale = cells / extentOf(all[box])[axis];
    return [(all[own].min[axis] - all[box].min[axis]) * scale, (extentOf(all[own])[axis] / nodes) * scale];
  }

  /** The first and one past the last of `count` macro cells that a group overlaps along an axis. */
  private overlap(axis: number, group: number, [first, apart]: [number, number], count: number): [number, number] {
    const low = first + group * this.edge * apart;
    const high = first + Math.min((group + 1) * this.edge, this.nodes[axis] - 1) * apart;
    // Cells that only touch do not overlap, and rounding is less than this.
    const within = (cell: number) => Math.min(Math.max(cell, 0), count);
    return [within(Math.floor(low + 1e-9)), within(Math.ceil(high - 1e-9))];
  }
}

/**
 * Replaces cells that are 0 or 255 by their distances. One sweep from each end, over the 13 neighbours already visited,
 * is exact for the Chebyshev distance.
 */
export function sweepBoth(cells: Uint8Array, counts: Triple): void {
  sweep(cells, counts);
  cells.reverse();
  sweep(cells, counts);
  cells.reverse();
}

/** Sets each cell to its smallest distance through the preceding cells. */
function sweep(skipDistances: Uint8Array, [nx, ny, nz]: Triple): void {
  // Of the plane before, the least of each cell and its 8 neighbours; of this plane, that of its 2 along the row.
  const before = new Uint8Array(ny * nz).fill(255);
  const rows = new Uint8Array(ny * nz);
  for (let x = 0, at = 0; x < nx; x++) {
    for (let y = 0, cell = 0; y < ny; y++) {
      const [start, end] = [cell, cell + nz];
      let last = 255;
      for (; cell < end; cell++, at++) {
        let least = skipDistances[at] - 1;
        if (before[cell] < least) least = before[cell];
        if (y > 0 && rows[cell - nz] < least) least = rows[cell - nz];
        if (last < least) least = last;
        last = least + 1;
        skipDistances[at] = last;
      }
      leastAlong(skipDistances, at - nz, rows, start, nz);
    }
    for (let y = 0, cell = 0; y < ny; y++) {
      const [low, high] = [y > 0 ? -nz : 0, y + 1 < ny ? nz : 0];
      for (const end = cell + nz; cell < end; cell++) {
        let least = rows[cell];
        if (rows[cell + low] < least) least = rows[cell + low];
        if (rows[cell + high] < least) least = rows[cell + high];
        before[cell] = least;
      }
    }
  }
}

/**
 * For a row of `count` values, the smallest of each value and its two neighbours; `from` and `to` are the first
 * indices.
 */
function leastAlong(values: Uint8Array, from: number, out: Uint8Array, to: number, count: number): void {
  let before = 255;
  let own = values[from];
  for (let i = 0; i < count; i++) {
    const next = i + 1 < count ? values[from + i + 1] : 255;
    let least = own < before ? own : before;
    if (next < least) least = next;
    out[to + i] = least;
    before = own;
    own = next;
  }
}
