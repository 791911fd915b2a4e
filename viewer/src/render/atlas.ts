/** Uploads decoded levels and shells to the device's textures. */

import { FieldError, REMEDY } from "../errors.js";
import { blockCounts, type Triple } from "../format/metadata.js";
import { boxesOf, levelOfPart, partsFrom, partsOf, partsOfLevel } from "../format/parts.js";
import type { DecodedPart, LevelEntry, Skips } from "../load/level.js";
import type { Opened } from "../load/loader.js";
import { slotPlace } from "../load/plan.js";
import { macroCounts } from "../load/skip.js";
import type { DeviceTexture, TextureDevice } from "./textureDevice.js";
import { allocate, macroStart, tableStarts, type Textures } from "./textures.js";

/** Maximum bytes and milliseconds of uploads per frame, so that no frame takes long. */
const [UPLOAD_BYTES, UPLOAD_MS] = [16 << 20, 8];
/** Maximum number of blocks per upload; the clock is checked between uploads. */
const UPLOAD_BLOCKS = 32;

/** Maximum number of macro cells per upload, at least one plane. */
const UPLOAD_CELLS = 1 << 15;

/**
 * A pending upload: blocks, or, after all blocks of a part, the part itself. `done` counts uploaded blocks or planes.
 */
type Upload = { part: DecodedPart; done: number } | { entry: LevelEntry; done: number };

/** The data of a field on one device. */
export class Atlas {
  /** Levels and shells whose blocks are all on the device. */
  readonly live = new Set<number>();
  /** Counts the parts entered into the tables. */
  entered = 0;
  /** The device; null before the first upload. */
  device: TextureDevice | null = null;
  /** Skip distances of each box, with those of four levels per texel, and macro cells along the box's axes. */
  private readonly skipDistances: { all: Uint8Array; counts: Triple }[];
  private uploads: Upload[] = [];
  /** Levels whose parts are still being decoded. */
  private readonly expected = new Set<number>();
  /** The textures of the live levels; null without a device. */
  textures: Textures | null = null;
  /** Stops listening for the loss of the device. */
  private deaf = () => {};

  /**
   * `refused` is called if the device has no room for the field. `isFed` tells whether all levels arrive from the first
   * one on; otherwise, they must be sent again when the device is known.
   */
  constructor(
    private readonly opened: Opened,
    private readonly refused: (error: FieldError) => void,
    private isFed: boolean,
  ) {
    const { metadata } = opened;
    this.skipDistances = boxesOf(metadata).map((_, box) => {
      const counts = macroCounts(metadata, box);
      const [x, y, z] = counts;
      return { all: new Uint8Array(x * y * z * Math.ceil((metadata.levels.length - box) / 4) * 4), counts };
    });
  }

  /** A level or a shell is being decoded. */
  expect(part: number): void {
    if (this.isFed) this.expected.add(part);
  }

  /** Expected parts will not arrive. */
  expectNothing(): void {
    this.expected.clear();
  }

  /** Whether all expected levels are on the device. */
  get isWhole(): boolean {
    const { metadata, plan } = this.opened;
    return this.live.size === partsFrom(metadata, plan.finest).length;
  }

  /** Adds blocks of a level. After the loss of a device, its data is sent again. */
  add(part: DecodedPart): void {
    if (this.isFed) this.uploads.push({ part, done: 0 });
  }

  /** Finishes a level whose blocks were all added. It is live after `upload` has brought them to the device. */
  finish(entry: LevelEntry): void {
    if (this.isFed) this.uploads.push({ entry, done: 0 });
    this.expected.delete(entry.part);
  }

  /** Whether anything waits for `upload`. */
  get waiting(): boolean {
    return this.uploads.length > 0;
  }

  /** Whether a level is being decoded. */
  get decoding(): boolean {
    return this.expected.size > 0;
  }

  /** The finest level that is live with its shell and all coarser levels; null if there is none. */
  get finest(): number | null {
    const { metadata } = this.opened;
    const { levels } = metadata;
    const isLive = (level: number) => partsOfLevel(metadata, level).every((part) => this.live.has(part));
    let finest: number | null = null;
    for (let level = levels.length - 1; level >= 0 && isLive(level); level--) finest = level;
    const whole = levels.every((level) => level.density !== null) || finest === 0;
    return whole ? finest : null;
  }

  /**
   * Uploads waiting blocks to the device, as many as suit one frame. Returns false if the device lost its data and all
   * levels must be sent again.
   */
  upload(device: TextureDevice): boolean {
    if (device.isLost) return true;
    if (!this.textures) {
      this.begin(device);
      const wasFed = this.isFed;
      this.isFed = true;
      if (!wasFed) return false;
    }
    const textures = this.textures!;
    if (this.waiting) device.keeping(() => this.bringSome(device, textures));
    return true;
  }

  dispose(): void {
    const { device, textures } = this;
    if (device && textures) for (const texture of Object.values(textures)) device.free(texture);
    this.forget();
  }

  private begin(device: TextureDevice): void {
    this.device = device;
    this.live.clear();
    this.deaf = device.onLost(this.forget);
    const textures = device.allocating(() => allocate(device, this.opened), () => {
      if (this.textures !== textures) return;
      const megabytes = Math.round(this.opened.plan.bytes / 1e6);
      this.refused(new FieldError(`The device has no room for ${megabytes} MB of textures.`, REMEDY.device));
    });
    this.textures = textures;
  }

  /** Forgets the data of a lost device, and pending uploads. */
  private readonly forget = (): void => {
    this.deaf();
    [this.textures, this.uploads, this.isFed] = [null, [], false];
    this.live.clear();
    this.expectNothing();
  };

  private bringSome(device: TextureDevice, textures: Textures): void {
    const end = performance.now() + UPLOAD_MS;
    let left = UPLOAD_BYTES;
    while (left > 0 && this.uploads.length > 0 && performance.now() < end) {
      const [upload] = this.uploads;
      if ("entry" in upload) {
        const before = this.entered;
        left -= this.enter(upload, device, textures);
        if (this.entered === before) continue;
      } else {
        left -= this.bring(upload, device, textures);
        if (upload.done < upload.part.blocks) continue;
      }
      this.uploads.shift();
    }
  }

  /** Uploads a few blocks with consecutive slots at once. Returns the number of bytes. */
  private bring(upload: { part: DecodedPart; done: number }, device: TextureDevice, textures: Textures): number {
    const { part, done } = upload;
    const { plan } = this.opened;
    const { slot, slots, quads, directionalQuads, firstSlot } = plan;
    const { side, density, color, directional, slots: own } = part;
    const nodes = side ** 3;
    const [x, y, z] = slotPlace(plan, own ? own[done] : firstSlot[part.part] + part.first + done);
    // Bricks that fill their slots lie in a row of slots as they lie in memory.
    const blocks = own ? 1 : side === slot ? Math.min(part.blocks - done, slots[2] - z, UPLOAD_BLOCKS) : 1;
    const put = (texture: DeviceTexture, z: number, values: ArrayBufferView) => {
      device.write(texture, [x * slot, y * slot, z * slot], [side, side, blocks * side], values);
    };
    if (density) put(textures.u_density!, z, density.subarray(done * nodes, (done + blocks) * nodes));
    const putQuads = (texture: DeviceTexture, quads: number, bricks: Uint8Array | Uint16Array) => {
      for (let quad = 0; quad < quads; quad++) {
        const at = (quad * part.blocks + done) * nodes * 4;
        put(texture, z + quad * slots[2], bricks.subarray(at, at + blocks * nodes * 4));
      }
    };
    putQuads(textures.u_color!, quads, color);
    if (directional) putQuads(textures.u_directional!, directionalQuads, directional);
    upload.done += blocks;
    const bytes = [density, color, directional].reduce((sum, bricks) => sum + (bricks?.byteLength ?? 0), 0);
    return (bytes * blocks) / part.blocks;
  }

  /** Enters a level into the tables, a few planes of macro cells at once. Returns the number of bytes. */
  private enter(upload: { entry: LevelEntry; done: number }, device: TextureDevice, textures: Textures): number {
    const { part, table, skips } = upload.entry;
    // The planes of one box come after those of another.
    let before = 0;
    for (const one of skips) {
      const [mx, my, mz] = this.skipDistances[one.box].counts;
      const from = upload.done - before;
      if (from < mx) {
        const to = Math.min(mx, from + Math.max(1, Math.floor(UPLOAD_CELLS / (my * mz))));
        upload.done = before + to;
        return this.putSkipDistances(part, one, [from, to], device, textures);
      }
      before += mx;
    }
    const { metadata, plan } = this.opened;
    const [nx, ny, nz] = blockCounts(partsOf(metadata)[part]);
    device.write(textures.u_table!, [0, 0, tableStarts(metadata, plan)[part]], [nz, ny, nx], table);
    this.live.add(part);
    this.entered++;
    return table.byteLength;
  }

  /**
   * Writes the planes `[from, to)` of a part's skip distances in a box, together with those of the levels that share
   * their texels.
   */
  private putSkipDistances(part: number, { box, distances }: Skips, [from, to]: [number, number], device: TextureDevice, textures: Textures): number {
    const { metadata } = this.opened;
    const { levels } = metadata;
    const { all, counts } = this.skipDistances[box];
    const [mx, my, mz] = counts;
    const [startY, startZ] = macroStart(metadata, box);
    // A box shows no level before its own number. Colour alone shows what level 0 shows.
    const level = levelOfPart(metadata, part) - box;
    const shown = part === 0 ? levels.flatMap((other, i) => (i === 0 || !other.density ? [i] : [])) : [level];
    const quads = new Set(shown.map((one) => Math.floor(one / 4)));
    for (const quad of quads) {
      const first = quad * mx * my * mz;
      const cells = all.subarray(4 * (first + from * my * mz), 4 * (first + to * my * mz));
      for (const one of shown) {
        if (Math.floor(one / 4) !== quad) continue;
        for (let at = one % 4, cell = from * my * mz; at < cells.length; at += 4, cell++) cells[at] = distances[cell];
      }
      device.write(textures.u_skipDistances!, [startZ, startY, quad * mx + from], [mz, my, to - from], cells);
    }
    return quads.size * 4 * (to - from) * my * mz;
  }
}
