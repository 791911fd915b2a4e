/**
 * Empty space that rays skip.
 *
 * The box is cut into macro cells of a few level-0 cells a side. A macro cell is occupied by a level if a sample of that
 * level can be visible in it. Each macro cell has, for each level, its skip distance: the Chebyshev distance to the
 * nearest occupied one. A ray jumps that far at once. `src/view/sample/skip.rs` of the reference renderer does the same.
 */

import type { Metadata, Triple } from "../format/metadata.js";
import { invisibleDensity } from "./interpolated.js";

/** Level-0 cells along a macro cell's edge where the box has few. */
const LEAST_EDGE = 2;
/** Macro cells along an axis, at most. */
const MOST_CELLS = 128;

/** Level-0 cells along a macro cell's edge. */
export function macroEdge(metadata: Metadata): number {
  const most = Math.max(...metadata.levels[0].dimensions) - 1;
  return Math.max(LEAST_EDGE, Math.ceil(most / MOST_CELLS));
}

/** Macro cells along each axis. */
export function macroCounts(metadata: Metadata): Triple {
  const edge = macroEdge(metadata);
  return metadata.levels[0].dimensions.map((nodes) => Math.ceil((nodes - 1) / edge)) as Triple;
}

/** Of the occupied macro cells along an axis, those at each end that may be stray. */
const STRAY = 0.005;

/** Two corners, as shares of the box, between which nearly all occupied macro cells lie. */
export function occupiedShares(skipDistances: Uint8Array, counts: Triple): [number[], number[]] {
  const [, ny, nz] = counts;
  const along = counts.map((count) => new Float64Array(count));
  let sum = 0;
  skipDistances.forEach((distance, cell) => {
    if (distance > 0) return;
    sum++;
    along[0][Math.floor(cell / nz / ny)]++;
    along[1][Math.floor(cell / nz) % ny]++;
    along[2][cell % nz]++;
  });
  if (sum === 0) return [[0, 0, 0], [1, 1, 1]];
  /** The first cell behind the stray ones. */
  const start = (cells: Float64Array) => {
    let passed = 0;
    return cells.findIndex((count) => (passed += count) > STRAY * sum);
  };
  return [along.map((cells, axis) => start(cells) / counts[axis]), along.map((cells, axis) => 1 - start(cells.slice().reverse()) / counts[axis])];
}

/** The macro cells of one level. */
export class MacroCells {
  private readonly edge: number;
  private readonly counts: Triple;
  private readonly finest: Triple;
  private readonly nodes: Triple;
  private readonly block: number;
  private readonly limit: number;

  constructor(metadata: Metadata, level: number) {
    const stored = metadata.levels[level];
    this.edge = macroEdge(metadata);
    this.counts = macroCounts(metadata);
    this.finest = metadata.levels[0].dimensions;
    this.nodes = stored.dimensions;
    this.block = stored.block_size;
    this.limit = invisibleDensity(metadata.activation, stored.density?.decode ?? "raw_density");
  }

  /** Skip distances for the level. `blocks` hold its densities with aprons. */
  skipDistances(blocks: Float32Array, places: Triple[]): Uint8Array {
    const [nx, ny, nz] = this.counts;
    const skipDistances = new Uint8Array(nx * ny * nz).fill(255);
    this.mark(this.groups(blocks, places), skipDistances);
    // One sweep from each end, over the 13 neighbours that it has passed, is exact for the largest of the
    // distances along the axes.
    sweep(skipDistances, this.counts);
    skipDistances.reverse();
    sweep(skipDistances, this.counts);
    return skipDistances.reverse();
  }

  /** Groups of `edge` cells of the level a side: 1 where a corner of one of them can be seen. */
  private groups(blocks: Float32Array, places: Triple[]): Uint8Array {
    const [gx, gy, gz] = this.groupCounts();
    const groups = new Uint8Array(gx * gy * gz);
    const side = this.block + 1;
    places.forEach((place, block) => {
      const first = place.map((block) => block * this.block);
      const end = first.map((first, axis) => Math.min(first + this.block, this.nodes[axis] - 1));
      // Only the last nodes of an axis, which are no cell's lowest.
      if (first.some((first, axis) => first === end[axis])) return;
      // The groups of the cells below and above a node, of those whose lowest nodes the block holds.
      const range = (axis: number, inside: number) => {
        const at = first[axis] + inside;
        return [Math.max(at - 1, first[axis]), Math.min(at, end[axis] - 1)].map((cell) => Math.floor(cell / this.edge));
      };
      const ranges = [0, 1, 2].map((axis) => Array.from({ length: side }, (_, inside) => range(axis, inside)));
      let node = block * side ** 3;
      for (let x = 0; x < side; x++) {
        for (let y = 0; y < side; y++) {
          for (let z = 0; z < side; z++, node++) {
            if (blocks[node] <= this.limit) continue;
            const [[x0, x1], [y0, y1], [z0, z1]] = [ranges[0][x], ranges[1][y], ranges[2][z]];
            for (let i = x0; i <= x1; i++) for (let j = y0; j <= y1; j++) for (let k = z0; k <= z1; k++) groups[(i * gy + j) * gz + k] = 1;
          }
        }
      }
    });
    return groups;
  }

  private groupCounts(): Triple {
    return this.nodes.map((nodes) => Math.ceil(nodes / this.edge)) as Triple;
  }

  /** Writes 0 into the macro cells that marked groups overlap. */
  private mark(groups: Uint8Array, skipDistances: Uint8Array): void {
    const [, gy, gz] = this.groupCounts();
    const [, ny, nz] = this.counts;
    const ranges = this.groupCounts().map((count, axis) => Array.from({ length: count }, (_, group) => this.overlap(axis, group)));
    groups.forEach((marked, group) => {
      if (!marked) return;
      const [xs, ys, zs] = [ranges[0][Math.floor(group / gz / gy)], ranges[1][Math.floor(group / gz) % gy], ranges[2][group % gz]];
      for (let x = xs[0]; x < xs[1]; x++) {
        for (let y = ys[0]; y < ys[1]; y++) skipDistances.fill(0, (x * ny + y) * nz + zs[0], (x * ny + y) * nz + zs[1]);
      }
    });
  }

  /** The first and one past the last macro cell that a group overlaps along an axis. */
  private overlap(axis: number, group: number): [number, number] {
    const toMacro = (this.finest[axis] - 1) / (this.edge * (this.nodes[axis] - 1));
    const low = group * this.edge * toMacro;
    const high = Math.min((group + 1) * this.edge, this.nodes[axis] - 1) * toMacro;
    // Cells that only touch do not overlap, and rounding is less than this.
    const [start, end] = [Math.floor(low + 1e-9), Math.ceil(high - 1e-9)];
    return [Math.min(start, this.counts[axis] - 1), Math.min(end, this.counts[axis])];
  }
}

function sweep(skipDistances: Uint8Array, [nx, ny, nz]: Triple): void {
  let at = 0;
  for (let x = 0; x < nx; x++) {
    for (let y = 0; y < ny; y++) {
      for (let z = 0; z < nz; z++, at++) {
        let least = skipDistances[at] - 1;
        for (let i = x > 0 ? -1 : 0; i <= 0; i++) {
          const [from, to] = [y > 0 ? -1 : 0, i < 0 && y + 1 < ny ? 1 : 0];
          for (let j = from; j <= to; j++) {
            const passed = i < 0 || j < 0;
            const last = passed ? (z + 1 < nz ? 1 : 0) : -1;
            for (let k = z > 0 ? -1 : 0; k <= last; k++) {
              const distance = skipDistances[at + (i * ny + j) * nz + k];
              if (distance < least) least = distance;
            }
          }
        }
        skipDistances[at] = least + 1;
      }
    }
  }
}
