/** Colours of inherited blocks, from the next coarser level: section 5 of `formats/mipvog.md`. */

import { blockCounts, type Encoding, type LevelMetadata, type Triple } from "../metadata.js";
import type { Codes } from "./atlas.js";
import { values } from "./values.js";

/** One group of colours of a level, with a frame for every block that has one. */
export interface Colors {
  level: LevelMetadata;
  /** Frame of each block, or -1. */
  frames: Int32Array;
  encoding: Encoding;
  codes: Codes;
  channels: number;
}

/** Nodes of an axis between two nodes of the coarser level: the lower node, and the weight of the upper one. */
interface Between {
  low: number[];
  share: number[];
}

/**
 * Codes of every block in `places`, from those of the stored blocks, in order. `inherited` marks the blocks without
 * codes of their own. They get the `coarser` level's colours at their nodes, interpolated along z, then y, then x, as
 * the nearest codes.
 */
export function inherit(
  { level, encoding, channels, name }: { level: LevelMetadata; encoding: Encoding; channels: number; name: string },
  stored: Codes,
  places: Triple[],
  inherited: (block: number) => boolean,
  coarser: Colors,
): Codes {
  const size = channels * level.block_size ** 3;
  const codes: Codes = encoding.number === "u8" ? new Uint8Array(places.length * size) : new Uint16Array(places.length * size);
  const value = values(encoding, name, (value) => value);
  const own = Array.from({ length: 2 ** encoding.bits }, (_, code) => value(code));
  const borders = own.slice(1).map((value, i) => (own[i] + value) / 2);
  const at = reader(coarser, name);
  let next = 0;
  places.forEach((place, block) => {
    const to = codes.subarray(block * size, (block + 1) * size);
    if (inherited(block)) inheritBlock(level, place, coarser, at, borders, to);
    else to.set(stored.subarray(next, (next += size)));
  });
  return codes;
}

function inheritBlock(level: LevelMetadata, place: Triple, coarser: Colors, value: Reader, borders: number[], codes: Codes): void {
  const edge = level.block_size;
  const [x, y, z] = place.map((block, axis) => between(level.dimensions[axis], coarser.level.dimensions[axis], block * edge, edge));
  const mix = (low: number, high: number, share: number) => low + share * (high - low);
  for (let channel = 0; channel < coarser.channels; channel++) {
    for (let i = 0; i < x.low.length; i++) {
      for (let j = 0; j < y.low.length; j++) {
        for (let k = 0; k < z.low.length; k++) {
          const alongZ = (upX: number, upY: number) => {
            const [nx, ny, nz] = [x.low[i] + upX, y.low[j] + upY, z.low[k]];
            return mix(value(channel, nx, ny, nz), value(channel, nx, ny, nz + 1), z.share[k]);
          };
          const alongY = (upX: number) => mix(alongZ(upX, 0), alongZ(upX, 1), y.share[j]);
          const mixed = mix(alongY(0), alongY(1), x.share[i]);
          codes[(channel * edge + i) * edge * edge + j * edge + k] = nearest(borders, mixed);
        }
      }
    }
  }
}

/** Positions in the coarser level of up to `count` nodes of an axis, from `start` on. */
function between(nodes: number, coarser: number, start: number, count: number): Between {
  const out: Between = { low: [], share: [] };
  for (let node = start; node < Math.min(nodes, start + count); node++) {
    const at = node * (coarser - 1);
    const low = Math.min(Math.floor(at / (nodes - 1)), coarser - 2);
    out.low.push(low);
    out.share.push((at - low * (nodes - 1)) / (nodes - 1));
  }
  return out;
}

/** A decoded value of the coarser level. */
type Reader = (channel: number, x: number, y: number, z: number) => number;

function reader({ level, frames, encoding, codes, channels }: Colors, name: string): Reader {
  const edge = level.block_size;
  const [, by, bz] = blockCounts(level);
  const value = values(encoding, name, (value) => value);
  const empty = Math.fround(encoding.empty);
  return (channel, x, y, z) => {
    const [i, j, k] = [Math.floor(x / edge), Math.floor(y / edge), Math.floor(z / edge)];
    const frame = frames[(i * by + j) * bz + k];
    if (frame < 0) return empty;
    const inside = ((x - i * edge) * edge + y - j * edge) * edge + z - k * edge;
    return value(codes[(frame * channels + channel) * edge ** 3 + inside]);
  };
}

/** The code whose value is nearest: the number of borders that are not above the value. */
function nearest(borders: number[], value: number): number {
  let [low, high] = [0, borders.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (borders[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low;
}
