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
import { partsFrom, partsOf, partsOfLevel } from "../format/parts.js";
import { macroSides } from "./skip.js";

/** What the device can hold. */
export interface DeviceLimits {
  /** Texels along a 3D texture. */
  side: number;
  /** Whether textures of 32-bit floats are interpolated by hardware; else density is in 16 bits. */
  floatLinear: boolean;
  /** Bytes of textures, at most. */
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
  /** Slots before the first one of each part; none where `isPartial`. */
  firstSlot: number[];
  /** Whether there are fewer slots than blocks, so that blocks get them and lose them as the camera moves. */
  isPartial: boolean;
  /** Bytes of all textures, and those that they may take. */
  bytes: number;
  most: number;
  floatLinear: boolean;
  /** Uniforms of four numbers that the device takes. */
  uniforms: number;
}

/** Quadruples of values that depend on the direction: anisotropy, then directional brightness. */
export const DIRECTIONAL_QUADS = 2;

/** Slots are numbered in the table of blocks with 10 bits along each axis. */
const MOST_SLOTS = 1024;

/** Of the room for blocks, the share that must be left for them: tables of finer levels than that are not worth it. */
const LEAST_SHARE = 0.5;

/** What all layouts of a field have in common. */
interface Measures {
  quads: number;
  slot: number;
  /** Bytes of a texel of both atlases. */
  texelBytes: number;
  directional: number | null;
  /** Slots that lie one behind the other, of the deepest atlas. */
  deepest: number;
  /** Bytes beside atlases and tables. */
  others: number;
}

/**
 * Lays out all levels down to `available`, or where they do not fit, coarsest first, as many as do. `others` are bytes of
 * textures beside those of atlases, tables and skip distances.
 */
export function plan(metadata: Metadata, device: DeviceLimits, available: number, others = 0): Plan {
  const quads = channelQuads(metadata);
  const directional = finestDirectional(metadata);
  const [x, y, z] = macroSides(metadata);
  const measures: Measures = {
    quads,
    slot: Math.max(...partsOf(metadata).map((part) => part.block_size)) + 1,
    texelBytes: (device.floatLinear ? 4 : 2) + 8 * quads,
    directional,
    deepest: directional === null ? quads : Math.max(quads, DIRECTIONAL_QUADS),
    others: others + 4 * x * y * z,
  };
  const whole = planWhole(metadata, device, available, measures);
  if (whole?.finest === available) return whole;
  const some = planSome(metadata, device, available, measures) ?? whole;
  if (some) return some;
  const blocks = blocksFrom(metadata, metadata.levels.length - 1);
  const megabytes = (bytes: number) => (bytes / 1e6).toFixed(1);
  const least = blocks * measures.slot ** 3 * measures.texelBytes + measures.others;
  if (least > device.bytes) {
    throw new FieldError(`This field's coarsest level needs ${megabytes(least)} MB of textures; ${megabytes(device.bytes)} MB are allowed.`, REMEDY.budget);
  }
  throw new FieldError(`This field's blocks do not fit in the textures of this device (${device.side} texels a side).`, REMEDY.device);
}

/** As many levels as fit whole; null where none does. */
function planWhole(metadata: Metadata, device: DeviceLimits, available: number, { quads, slot, texelBytes, directional, deepest, others }: Measures): Plan | null {
  const { levels } = metadata;
  const parts = partsOf(metadata);
  const firstSlot = new Array<number>(parts.length).fill(0);
  let fitting: Plan | null = null;
  let count = 0;
  let directionalSlots = 0;
  for (let finest = levels.length - 1; finest >= available; finest--) {
    for (const part of partsOfLevel(metadata, finest)) {
      firstSlot[part] = count;
      count += parts[part].blocks_stored;
    }
    if (directional !== null && finest >= directional) directionalSlots = count;
    const slots = arrange(Math.max(count, 1), device.side, slot, deepest);
    const table = tableSides(metadata, finest);
    if (!slots || Math.max(...table) > device.side) break;
    const directionalRows = Math.ceil(directionalSlots / (slots[0] * slots[2]));
    const directionalBytes = directionalRows * 8 * DIRECTIONAL_QUADS;
    const bytes = slots[0] * slots[2] * slot ** 3 * (slots[1] * texelBytes + directionalBytes) + tableBytes(table) + others;
    if (bytes > device.bytes) break;
    const renders = finest === 0 || levels.every((level) => level.density !== null);
    if (renders) fitting = { finest, slot, slots, quads, directionalRows, firstSlot: [...firstSlot], isPartial: false, bytes, most: device.bytes, floatLinear: device.floatLinear, uniforms: device.uniforms };
  }
  return fitting;
}

/**
 * Room for a part of the blocks of all levels, which those near the camera get; null where the coarsest level does not fit.
 * The finest levels whose tables alone would take too much are left out.
 */
function planSome(metadata: Metadata, device: DeviceLimits, available: number, { quads, slot, texelBytes, directional, deepest, others }: Measures): Plan | null {
  const { levels } = metadata;
  // Where all levels are drawn with the densities of one, it has to be whole.
  if (levels.some((level) => level.density === null)) return null;
  const least = blocksFrom(metadata, levels.length - 1);
  for (let finest = available; finest < levels.length; finest++) {
    const table = tableSides(metadata, finest);
    const room = device.bytes - others - tableBytes(table);
    if (Math.max(...table) > device.side || room < LEAST_SHARE * (device.bytes - others)) continue;
    const slotBytes = slot ** 3 * (texelBytes + (directional === null ? 0 : 8 * DIRECTIONAL_QUADS));
    const slots = arrangeWithin(Math.floor(room / slotBytes), device.side, slot, deepest);
    const count = slots ? slots[0] * slots[1] * slots[2] : 0;
    if (!slots || count < least) continue;
    const bytes = count * slotBytes + tableBytes(table) + others;
    const directionalRows = directional === null ? 0 : slots[1];
    return { finest, slot, slots, quads, directionalRows, firstSlot: [], isPartial: true, bytes, most: device.bytes, floatLinear: device.floatLinear, uniforms: device.uniforms };
  }
  return null;
}

/** Stored blocks of all levels and shells from a level on. */
export function blocksFrom(metadata: Metadata, finest: number): number {
  return partsFrom(metadata, finest).reduce((sum, part) => sum + partsOf(metadata)[part].blocks_stored, 0);
}

/** Sides of the table of blocks along the field's axes, from a level on. */
function tableSides(metadata: Metadata, finest: number): Triple {
  const counts = partsFrom(metadata, finest).map((part) => blockCounts(partsOf(metadata)[part]));
  return [counts.reduce((sum, [x]) => sum + x, 0), Math.max(...counts.map(([, y]) => y)), Math.max(...counts.map(([, , z]) => z))];
}

function tableBytes([x, y, z]: Triple): number {
  return 4 * x * y * z;
}

/** Slots along an axis, and along the one where quadruples lie behind each other, at most. */
function mostSlots(side: number, slot: number, quads: number): [number, number] {
  const most = Math.min(MOST_SLOTS, Math.floor(side / slot));
  return [most, Math.min(most, Math.floor(side / (slot * quads)))];
}

/** Slots along each axis for `count` of them, as near to a cube as fits. */
function arrange(count: number, side: number, slot: number, quads: number): Triple | null {
  const [most, deepest] = mostSlots(side, slot, quads);
  if (most < 1 || deepest < 1) return null;
  const z = Math.min(deepest, Math.ceil(Math.cbrt(count)));
  const x = Math.min(most, Math.ceil(Math.sqrt(count / z)));
  const y = Math.ceil(count / (x * z));
  return y <= most ? [x, y, z] : null;
}

/** Slots along each axis, `count` of them at most. */
function arrangeWithin(count: number, side: number, slot: number, quads: number): Triple | null {
  const [most, deepest] = mostSlots(side, slot, quads);
  if (most < 1 || deepest < 1 || count < 1) return null;
  const z = Math.min(deepest, Math.floor(Math.cbrt(count)));
  const x = Math.min(most, Math.floor(Math.sqrt(count / z)));
  return [x, Math.min(most, Math.floor(count / (x * z))), z];
}

/** The place of a slot. Slots along z follow each other, so that their bricks, one behind the other, are one box of texels. */
export function slotPlace({ slots: [x, , z] }: Plan, slot: number): Triple {
  return [Math.floor(slot / z) % x, Math.floor(slot / (x * z)), slot % z];
}
