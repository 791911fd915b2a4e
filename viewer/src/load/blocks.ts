/** The stored blocks of a part: chunk TABL. */

import { FieldError } from "../errors.js";
import type { Triple } from "../format/metadata.js";
import { contentSize, inflate } from "../format/zstd.js";

/** Table entry of a block that is stored in the file but not on the device. */
export const ABSENT = 2 ** 32 - 1;
/** Number of bits of a run's number that hold the kind of its blocks. */
const KIND_BITS = 4;

/** The kind of each of `total` blocks, in a file with shells: run-length coded. */
function fromRuns(chunk: { name: string; bytes: Uint8Array }, total: number): Uint8Array {
  const no = (what: string) => new FieldError(`${chunk.name} ${what}.`);
  const size = contentSize(chunk.bytes);
  if (size === null || !(size <= total)) throw no("does not say how long its runs are, or has more of them than blocks");
  const bytes = inflate(chunk.bytes, size, chunk.name);
  const occupied = new Uint8Array(total);
  let [done, before] = [0, -1];
  for (let at = 0; at < size; ) {
    // A number in groups of 7 bits, lowest first. Those beyond 2^53 are longer than any level.
    let [number, scale] = [0, 1];
    const first = at;
    do {
      number += (bytes[at] & 127) * scale;
      scale *= 128;
    } while (bytes[at++] > 127 && at < size && at - first < 9);
    const isWhole = bytes[at - 1] < 128 && (bytes[at - 1] > 0 || at - first === 1);
    const [length, kind] = [Math.floor(number / KIND_BITS), number % KIND_BITS];
    if (!isWhole || length < 1 || length > total - done || kind > 2 || kind === before) throw no(`has a run after block ${done} that cannot be`);
    occupied.fill(kind, done, done + length);
    [done, before] = [done + length, kind];
  }
  if (done !== total) throw no(`has runs of ${done} blocks, of ${total}`);
  return occupied;
}

export class Blocks {
  /** Positions of the blocks with a frame, in order. */
  readonly places: Triple[] = [];
  /** Frame of each block in C order; -1 without one. */
  readonly frames: Int32Array;
  readonly inheritedCount: number;
  /** For each frame, whether the block's colours are inherited from the next coarser level. */
  private readonly inherited: boolean[] = [];

  constructor(
    readonly counts: Triple,
    chunk: { name: string; bytes: Uint8Array },
    /** Whether the chunk is run-length coded. */
    inRuns = false,
  ) {
    const [nx, ny, nz] = counts;
    const occupied = inRuns ? fromRuns(chunk, nx * ny * nz) : inflate(chunk.bytes, nx * ny * nz, chunk.name);
    this.frames = new Int32Array(occupied.length).fill(-1);
    occupied.forEach((stored, block) => {
      if (stored > 2) throw new FieldError(`${chunk.name} says ${stored} of block ${block}, neither empty nor stored nor inherited.`);
      if (stored === 0) return;
      this.frames[block] = this.places.length;
      this.inherited.push(stored === 2);
      this.places.push([Math.floor(block / nz / ny), Math.floor(block / nz) % ny, block % nz]);
    });
    this.inheritedCount = this.inherited.filter((inherited) => inherited).length;
  }

  isInherited(frame: number): boolean {
    return this.inherited[frame];
  }

  /** The frame of a block; -1 if it is not stored or does not exist. */
  frame(x: number, y: number, z: number): number {
    const [nx, ny, nz] = this.counts;
    return x < nx && y < ny && z < nz ? this.frames[(x * ny + y) * nz + z] : -1;
  }

  /** One past the last frame whose nodes the frames before `end` repeat. */
  reach(end: number): number {
    if (end === 0) return 0;
    const [nx, ny, nz] = this.counts;
    const [x, y, z] = this.places[end - 1];
    // Of the last block, the furthest neighbour is furthest of all; where it has none along x or y, blocks before it have
    // neighbours anywhere in the last plane that it reaches.
    const block = x + 1 < nx && y + 1 < ny ? ((x + 1) * ny + y + 1) * nz + Math.min(z + 1, nz - 1) : Math.min(x + 2, nx) * ny * nz - 1;
    let low = end;
    for (let high = this.places.length; low < high; ) {
      const middle = (low + high) >> 1;
      const [i, j, k] = this.places[middle];
      if ((i * ny + j) * nz + k <= block) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /**
   * The device's table of the blocks: one more than the first texel of each block's slot, with 11 bits each for x and y
   * and 10 for z; 0 if the block is not stored, `ABSENT` if `place` has no slot for it.
   */
  table(place: (frame: number) => Triple | null): Uint32Array {
    return Uint32Array.from(this.frames, (frame) => {
      if (frame < 0) return 0;
      const found = place(frame);
      if (!found) return ABSENT;
      const [x, y, z] = found;
      return ((z << 22) | (y << 11) | x) + 1;
    });
  }
}
