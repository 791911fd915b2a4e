/**
 * The places of stored blocks in the device's textures.
 *
 * All levels and shells share an atlas of density and one of colour. A stored block takes one slot of both, a cube of
 * its nodes. A texture's x is the field's z, so nodes are in file order.
 *
 * Direction-dependent values, which only some levels have, are in a third atlas. It has the same slots, but only as
 * many rows along y as those levels need: they have the first slots. Among levels alike in this, the coarsest comes
 * first.
 */

import { FieldError, REMEDY } from "../errors.js";
import { ANISOTROPY, blockCounts, channelQuads, DIRECTIONAL, hasLevels, type Metadata, type Triple } from "../format/metadata.js";
import { partsFrom, partsOf } from "../format/parts.js";
import { macroSides } from "./skip.js";
import { TEXEL_BYTES, type Texels, texelsOf } from "./texels.js";

/** The limits of a device. */
export interface DeviceLimits {
  /** Maximum texels along a 3D texture. */
  side: number;
  /** Maximum bytes of textures. */
  bytes: number;
  /** Maximum number of four-component uniforms in a fragment shader. */
  uniforms: number;
}

export interface Plan {
  /** The finest level that fits. */
  finest: number;
  /** Texels along each edge of a slot. */
  slot: number;
  /** Slots along the atlas's x, y and z. */
  slots: Triple;
  /**
   * Number of quadruples of colour channels. Each has its own slot of the colour atlas; they are consecutive along z.
   */
  quads: number;
  /** Number of quadruples of direction-dependent values, anisotropy before directional brightness; 0 without any. */
  directionalQuads: number;
  /** Number of rows of slots along the y of the direction-dependent atlas. */
  directionalRows: number;
  /** Number of slots before the first one of each part; empty if `isPartial`. */
  firstSlot: number[];
  /** Whether there are fewer slots than blocks, so blocks gain and lose slots as the camera moves. */
  isPartial: boolean;
  /** Bytes of all textures, and their limit. */
  bytes: number;
  most: number;
  texels: Texels;
  /** Maximum number of four-component uniforms. */
  uniforms: number;
}

/** Table entries have 11 bits for texels along x and y, and 10 along z. */
const [MOST_TEXELS, DEEPEST_TEXELS] = [2048, 1024];

/** Minimum share of the memory that must remain for blocks: levels whose tables take more are left out. */
const LEAST_SHARE = 0.5;

/** Whether a part has direction-dependent values. */
export function partIsDirectional(metadata: Metadata, part: number): boolean {
  const { anisotropy, directional } = partsOf(metadata)[part];
  return (anisotropy ?? directional) !== undefined;
}

/** Measures that all layouts of a field share. */
interface Measures {
  quads: number;
  slot: number;
  texels: Texels;
  directionalQuads: number;
  /** Bytes of a slot of density and colour, and of a slot of direction-dependent values. */
  slotBytes: number;
  directionalBytes: number;
  /** Number of consecutive slots per block in the deepest atlas. */
  deepest: number;
  /** Bytes of other textures. */
  others: number;
}

function measuresOf(metadata: Metadata, others: number): Measures {
  const [quads, texels] = [channelQuads(metadata), texelsOf(metadata)];
  const channels = (hasLevels(metadata, "anisotropy") ? ANISOTROPY : 0) + (hasLevels(metadata, "directional") ? DIRECTIONAL : 0);
  const directionalQuads = Math.ceil(channels / 4);
  const slot = Math.max(...partsOf(metadata).map((part) => part.block_size));
  const [x, y, z] = macroSides(metadata);
  return {
    quads,
    slot,
    texels,
    directionalQuads,
    slotBytes: slot ** 3 * (TEXEL_BYTES[texels.density] + 4 * quads * TEXEL_BYTES[texels.color]),
    directionalBytes: slot ** 3 * 4 * directionalQuads * TEXEL_BYTES[texels.directional],
    deepest: Math.max(quads, directionalQuads),
    others: others + 4 * x * y * z,
  };
}

/**
 * Lays out all levels down to `available`. If they do not fit, as many as fit, coarsest first. `others` are bytes of
 * textures besides atlases, tables and skip distances.
 */
export function plan(metadata: Metadata, device: DeviceLimits, available: number, others = 0): Plan {
  const measures = measuresOf(metadata, others);
  const whole = planWhole(metadata, device, available, measures);
  if (whole?.finest === available) return whole;
  const some = planSome(metadata, device, available, measures) ?? whole;
  if (some) return some;
  const blocks = blocksFrom(metadata, metadata.levels.length - 1);
  const megabytes = (bytes: number) => (bytes / 1e6).toFixed(1);
  const least = blocks * measures.slotBytes + measures.others;
  if (least > device.bytes) {
    throw new FieldError(`This field's coarsest level needs ${megabytes(least)} MB of textures; ${megabytes(device.bytes)} MB are allowed.`, REMEDY.budget);
  }
  throw new FieldError(`This field's blocks do not fit in the textures of this device (${device.side} texels a side).`, REMEDY.device);
}

/** As many complete levels as fit; null if none fits. */
function planWhole(metadata: Metadata, device: DeviceLimits, available: number, measures: Measures): Plan | null {
  const { levels } = metadata;
  const parts = partsOf(metadata);
  const { quads, slot, texels, directionalQuads, directionalBytes, others } = measures;
  let fitting: Plan | null = null;
  for (let finest = levels.length - 1; finest >= available; finest--) {
    const own = partsFrom(metadata, finest);
    const directional = own.filter((part) => partIsDirectional(metadata, part));
    const firstSlot = new Array<number>(parts.length).fill(0);
    let [count, directionalSlots] = [0, 0];
    for (const part of [...directional, ...own.filter((part) => !directional.includes(part))]) {
      firstSlot[part] = count;
      count += parts[part].blocks_stored;
      if (directional.includes(part)) directionalSlots = count;
    }
    const slots = arrange(Math.max(count, 1), directionalSlots, device.side, measures);
    const table = tableSides(metadata, finest);
    if (!slots || Math.max(...table) > device.side) break;
    const directionalRows = rowsOf(directionalSlots, slots);
    const bytes = bytesOf(slots, directionalRows, measures) + tableBytes(table) + others;
    if (bytes > device.bytes) break;
    const renders = finest === 0 || levels.every((level) => level.density !== null);
    const isAny = directionalBytes > 0 && directionalRows > 0;
    if (renders) fitting = { finest, slot, slots, quads, directionalQuads: isAny ? directionalQuads : 0, directionalRows, firstSlot, isPartial: false, bytes, most: device.bytes, texels, uniforms: device.uniforms };
  }
  return fitting;
}

/**
 * Room for a part of the blocks of all levels, for those near the camera. Null if the coarsest level does not fit. The
 * finest levels are left out if their tables alone are too large.
 */
function planSome(metadata: Metadata, device: DeviceLimits, available: number, measures: Measures): Plan | null {
  const { levels } = metadata;
  const { quads, slot, texels, directionalQuads, slotBytes, directionalBytes, others } = measures;
  // Where all levels are drawn with the densities of one, it has to be whole.
  if (levels.some((level) => level.density === null)) return null;
  const least = blocksFrom(metadata, levels.length - 1);
  for (let finest = available; finest < levels.length; finest++) {
    const table = tableSides(metadata, finest);
    const room = device.bytes - others - tableBytes(table);
    if (Math.max(...table) > device.side || room < LEAST_SHARE * (device.bytes - others)) continue;
    const slots = arrangeWithin(Math.floor(room / (slotBytes + directionalBytes)), device.side, measures);
    const count = slots ? slots[0] * slots[1] * slots[2] : 0;
    if (!slots || count < least) continue;
    const directionalRows = directionalQuads > 0 ? slots[1] : 0;
    const bytes = bytesOf(slots, directionalRows, measures) + tableBytes(table) + others;
    return { finest, slot, slots, quads, directionalQuads, directionalRows, firstSlot: [], isPartial: true, bytes, most: device.bytes, texels, uniforms: device.uniforms };
  }
  return null;
}

/** Number of rows along y for `count` slots. */
function rowsOf(count: number, [x, , z]: Triple): number {
  return Math.ceil(count / (x * z));
}

/** Bytes of the atlases. */
function bytesOf([x, y, z]: Triple, directionalRows: number, { slotBytes, directionalBytes }: Measures): number {
  return x * z * (y * slotBytes + directionalRows * directionalBytes);
}

/** Number of stored blocks in all levels and shells from a level on. */
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

/** Maximum number of slots along an axis, and along the axis of consecutive quadruples. */
function mostSlots(side: number, { slot, deepest }: Measures): [number, number] {
  const most = Math.floor(Math.min(side, MOST_TEXELS) / slot);
  return [most, Math.min(most, Math.floor(Math.min(DEEPEST_TEXELS, side / deepest) / slot))];
}

/**
 * Slots along each axis for `count` slots, of which `directional` are in the third atlas. Tries numbers along z from
 * that of a cube to twice as many, and picks the one with the least unused space. Null if they do not fit.
 */
function arrange(count: number, directional: number, side: number, measures: Measures): Triple | null {
  const [most, deepest] = mostSlots(side, measures);
  let best: { slots: Triple; bytes: number } | null = null;
  const cube = Math.min(deepest, Math.ceil(Math.cbrt(count)));
  for (let z = Math.max(cube, 1); z <= Math.min(deepest, 2 * cube, count); z++) {
    const square = Math.ceil(Math.sqrt(count / z));
    for (let x = Math.ceil(square / 2); x <= Math.min(most, 2 * square); x++) {
      const slots: Triple = [x, Math.ceil(count / (x * z)), z];
      const bytes = bytesOf(slots, rowsOf(directional, slots), measures);
      if (slots[1] <= most && (!best || bytes < best.bytes)) best = { slots, bytes };
    }
  }
  return best && best.slots;
}

/** Slots along each axis, at most `count` in total. */
function arrangeWithin(count: number, side: number, measures: Measures): Triple | null {
  const [most, deepest] = mostSlots(side, measures);
  if (most < 1 || deepest < 1 || count < 1) return null;
  const z = Math.min(deepest, Math.floor(Math.cbrt(count)));
  const x = Math.min(most, Math.floor(Math.sqrt(count / z)));
  return [x, Math.min(most, Math.floor(count / (x * z))), z];
}

/** The place of a slot. Slots along z are consecutive, so their bricks form one box of texels. */
export function slotPlace({ slots: [x, , z] }: Plan, slot: number): Triple {
  return [Math.floor(slot / z) % x, Math.floor(slot / (x * z)), slot % z];
}
