/**
 * Where stored blocks lie in the device's textures.
 *
 * All levels and shells share an atlas of density and one of colour. A stored block takes a slot of both, a cube of
 * nodes one wider than a block: on its upper sides it repeats the lowest nodes of its neighbours, so that hardware
 * interpolates every cell of a block within the slot. The coarsest level has the first slots. A texture's x is the
 * field's z, so that nodes lie as in the file.
 *
 * What depends on the direction, which only coarser levels have, lies in a third atlas with the same slots, as many rows
 * of them along y as those levels take.
 */

import { FieldError, REMEDY } from "../errors.js";
import { blockCounts, channelQuads, finestDirectional, type Metadata, type Triple } from "../format/metadata.js";
import { partsOf, partsOfLevel } from "../format/parts.js";

/** What the device can hold. */
export interface DeviceLimits {
  /** Texels along a 3D texture. */
  side: number;
  /** Whether textures of 32-bit floats are interpolated by hardware; else density is in 16 bits. */
  floatLinear: boolean;
  /** Bytes of atlases, at most. */
  bytes: number;
  /** Uniforms of four numbers that a fragment shader may have. */
  uniforms: number;
}

export interface Plan {
  /** The finest level that fits. */
  finest: number;
  /** Texels along a slot. */
  slot: number;
  /** Slots along the atlas's x, y and z. */
  slots: Triple;
  /** Quadruples of colour channels; each has its own slot of the colour atlas, one behind the other along z. */
  quads: number;
  /** Slots of the atlas of what depends on the direction along its y; 0 where nothing does. */
  directionalRows: number;
  /** Slots before the first one of each part. */
  firstSlot: number[];
  /** Bytes of all atlases and the table of blocks. */
  bytes: number;
  floatLinear: boolean;
  /** Uniforms of four numbers that the device takes. */
  uniforms: number;
}

/** Quadruples of values that depend on the direction: anisotropy, then directional brightness. */
export const DIRECTIONAL_QUADS = 2;

/** Slots are numbered in the table of blocks with 10 bits along each axis. */
const MOST_SLOTS = 1024;

/** Lays out as many levels as fit, coarsest first, down to level `available`. */
export function plan(metadata: Metadata, device: DeviceLimits, available: number): Plan {
  const { levels } = metadata;
  const quads = channelQuads(metadata);
  const directional = finestDirectional(metadata);
  const parts = partsOf(metadata);
  const slot = Math.max(...parts.map((part) => part.block_size)) + 1;
  const texelBytes = (device.floatLinear ? 4 : 2) + 8 * quads;
  const firstSlot = new Array<number>(parts.length).fill(0);
  let fitting: Plan | null = null;
  let count = 0;
  let directionalSlots = 0;
  const table: Triple = [0, 0, 0];
  for (let finest = levels.length - 1; finest >= available; finest--) {
    for (const part of partsOfLevel(metadata, finest)) {
      const [x, y, z] = blockCounts(parts[part]);
      [table[0], table[1], table[2]] = [table[0] + x, Math.max(table[1], y), Math.max(table[2], z)];
      firstSlot[part] = count;
      count += parts[part].blocks_stored;
    }
    if (directional !== null && finest >= directional) directionalSlots = count;
    const deepest = directional === null ? quads : Math.max(quads, DIRECTIONAL_QUADS);
    const slots = arrange(Math.max(count, 1), device.side, slot, deepest);
    if (!slots || Math.max(...table) > device.side) break;
    const tableBytes = 4 * table[0] * table[1] * table[2];
    const directionalRows = Math.ceil(directionalSlots / (slots[0] * slots[2]));
    const directionalBytes = directionalRows * 8 * DIRECTIONAL_QUADS;
    const bytes = slots[0] * slots[2] * slot ** 3 * (slots[1] * texelBytes + directionalBytes) + tableBytes;
    if (bytes > device.bytes) break;
    const renders = finest === 0 || levels.every((level) => level.density !== null);
    if (renders) fitting = { finest, slot, slots, quads, directionalRows, firstSlot: [...firstSlot], bytes, floatLinear: device.floatLinear, uniforms: device.uniforms };
  }
  if (fitting) return fitting;
  throw new FieldError(`This field's ${count} blocks do not fit in the textures of this device (${device.side} texels a side).`, REMEDY.device);
}

/** Slots along each axis for `count` of them, as near to a cube as fits. */
function arrange(count: number, side: number, slot: number, quads: number): Triple | null {
  const most = Math.min(MOST_SLOTS, Math.floor(side / slot));
  const deepest = Math.min(most, Math.floor(side / (slot * quads)));
  if (most < 1 || deepest < 1) return null;
  const z = Math.min(deepest, Math.ceil(Math.cbrt(count)));
  const x = Math.min(most, Math.ceil(Math.sqrt(count / z)));
  const y = Math.ceil(count / (x * z));
  return y <= most ? [x, y, z] : null;
}

/** The place of a slot. Slots along z follow each other, so that their bricks, one behind the other, are one box of texels. */
export function slotPlace({ slots: [x, , z] }: Plan, slot: number): Triple {
  return [Math.floor(slot / z) % x, Math.floor(slot / (x * z)), slot % z];
}
