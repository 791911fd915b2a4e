/** The device's textures of a field, and the way of decoded levels into them. */

import {
  ClampToEdgeWrapping,
  Data3DTexture,
  DataTexture,
  FloatType,
  HalfFloatType,
  LinearFilter,
  NearestFilter,
  RedFormat,
  RedIntegerFormat,
  RGBAFormat,
  RGBAIntegerFormat,
  UnsignedByteType,
  UnsignedIntType,
  type Texture,
  type WebGLRenderer,
} from "three";
import { FieldError, REMEDY } from "../errors.js";
import { blockCounts, type Triple } from "../format/metadata.js";
import type { DecodedPart, LevelEntry } from "../load/level.js";
import type { Opened } from "../load/loader.js";
import { type Plan, slotPlace } from "../load/plan.js";
import { macroCounts, occupiedShares } from "../load/skip.js";
import { packWeights, WEIGHTS_WIDTH } from "./network.js";

/** Bytes that go to the device in one frame, at most, and milliseconds that they may take, so that no frame takes long. */
const [UPLOAD_BYTES, UPLOAD_MS] = [16 << 20, 8];
/** Blocks between two looks at the clock. */
const UPLOAD_BLOCKS = 32;

/** What is on its way to the device: blocks, and after all of a level's the level itself. */
type Upload = { part: DecodedPart; done: number } | { entry: LevelEntry };

export class Atlas {
  readonly density: Data3DTexture;
  readonly color: Data3DTexture;
  readonly table: Data3DTexture;
  readonly skipDistances: Data3DTexture;
  readonly weights: DataTexture;
  readonly mask: Data3DTexture | null;
  /** Where each level's table starts along the field's x. */
  readonly tableStart: number[] = [];
  /** Levels whose blocks are all there. */
  readonly live = new Set<number>();
  private readonly plan: Plan;
  private readonly tables: Uint32Array;
  private readonly tableSize: Triple;
  private readonly skipDistanceBytes: Uint8Array;
  private readonly macro: Triple;
  /** Two corners, as shares of the box, of what the first level to come shows; null before. */
  occupied: [number[], number[]] | null = null;
  private uploads: Upload[] = [];
  /** The texture that holds what was uploaded: another one after the context was lost. */
  private holder: WebGLTexture | null = null;

  constructor(private readonly opened: Opened) {
    const { metadata, plan, network, mask } = opened;
    this.plan = plan;
    const [x, y, z] = plan.slots.map((slots) => slots * plan.slot) as Triple;
    this.density = volume(null, [x, y, z], RedFormat, plan.floatLinear ? FloatType : HalfFloatType);
    this.color = volume(null, [x, y, z * plan.quads], RGBAFormat, HalfFloatType);
    for (const texture of [this.density, this.color]) {
      texture.minFilter = texture.magFilter = LinearFilter;
      // Storage alone: blocks come one by one.
      texture.source.dataReady = false;
    }
    const counts = metadata.levels.map(blockCounts);
    let depth = 0;
    counts.forEach(([x], level) => {
      this.tableStart.push(level < plan.finest ? 0 : depth);
      if (level >= plan.finest) depth += x;
    });
    const widest = counts[plan.finest];
    this.tableSize = [widest[2], widest[1], depth];
    this.tables = new Uint32Array(widest[2] * widest[1] * depth);
    this.table = volume(this.tables, this.tableSize, RedIntegerFormat, UnsignedIntType, "R32UI");
    this.macro = macroCounts(metadata);
    const [mx, my, mz] = this.macro;
    const quads = Math.ceil(metadata.levels.length / 4);
    this.skipDistanceBytes = new Uint8Array(mx * my * mz * quads * 4);
    this.skipDistances = volume(this.skipDistanceBytes, [mz, my, mx * quads], RGBAIntegerFormat, UnsignedByteType, "RGBA8UI");
    const packed = packWeights(network);
    this.weights = new DataTexture(packed, WEIGHTS_WIDTH, packed.length / 4 / WEIGHTS_WIDTH, RGBAFormat, FloatType);
    this.weights.needsUpdate = true;
    this.mask = mask && volume(mask.values, [mask.nodes[2], mask.nodes[1], mask.nodes[0]], RedFormat, FloatType);
  }

  /** Takes blocks of a level. */
  add(part: DecodedPart): void {
    this.uploads.push({ part, done: 0 });
  }

  /** Takes a level all of whose blocks were added; it is live when `upload` has brought them to the device. */
  finish(entry: LevelEntry): void {
    this.uploads.push({ entry });
    if (entry.skipDistances) this.occupied ??= occupiedShares(entry.skipDistances, this.macro);
  }

  /** Whether something waits for `upload`. */
  get waiting(): boolean {
    return this.uploads.length > 0;
  }

  /** The finest live level without a hole below it; null where there is none. */
  get finest(): number | null {
    const { levels } = this.opened.metadata;
    let finest: number | null = null;
    for (let level = levels.length - 1; level >= 0 && this.live.has(level); level--) finest = level;
    const whole = levels.every((level) => level.density !== null) || finest === 0;
    return whole ? finest : null;
  }

  /**
   * Brings waiting blocks to the device, as many as a frame should. False where the device has lost what it had and
   * all levels have to come again.
   */
  upload(renderer: WebGLRenderer): boolean {
    const { properties } = renderer;
    const handle = (texture: Texture) => (properties.get(texture) as { __webglTexture?: WebGLTexture }).__webglTexture ?? null;
    if (!this.holder || handle(this.density) !== this.holder) {
      const lost = this.holder !== null;
      this.allocate(renderer);
      this.holder = handle(this.density);
      this.live.clear();
      if (lost) {
        this.uploads = [];
        return false;
      }
    }
    if (!this.waiting) return true;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    const end = performance.now() + UPLOAD_MS;
    let left = UPLOAD_BYTES;
    // three.js remembers the state of the context, so it is told; before release 187 it does not remember these.
    const state = renderer.state as typeof renderer.state & Partial<Pick<WebGL2RenderingContext, "pixelStorei">>;
    const set = (name: number, value: number | boolean) => ("pixelStorei" in state ? state : gl).pixelStorei!(name, value);
    set(gl.UNPACK_ALIGNMENT, 1);
    set(gl.UNPACK_FLIP_Y_WEBGL, false);
    set(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    while (left > 0 && this.uploads.length > 0 && performance.now() < end) {
      const [upload] = this.uploads;
      if ("entry" in upload) this.enter(upload.entry);
      else {
        left -= this.bring(upload, gl, (texture) => state.bindTexture(gl.TEXTURE_3D, handle(texture)!));
        if (upload.done < upload.part.blocks) continue;
      }
      this.uploads.shift();
    }
    return true;
  }

  dispose(): void {
    for (const texture of [this.density, this.color, this.table, this.skipDistances, this.weights, this.mask]) texture?.dispose();
  }

  private allocate(renderer: WebGLRenderer): void {
    const gl = renderer.getContext();
    // Errors of before are not ours.
    while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
    for (const texture of [this.density, this.color]) {
      texture.needsUpdate = true;
      renderer.initTexture(texture);
    }
    if (gl.getError() === gl.OUT_OF_MEMORY) {
      throw new FieldError(`The device has no room for ${Math.round(this.plan.bytes / 1e6)} MB of textures.`, REMEDY.device);
    }
  }

  /** Uploads a few blocks; how many bytes that were. */
  private bring(upload: { part: DecodedPart; done: number }, gl: WebGL2RenderingContext, bind: (texture: Texture) => void): number {
    const { part } = upload;
    const { slot, slots, quads, firstSlot } = this.plan;
    const nodes = part.side ** 3;
    const blockBytes = nodes * (8 * quads + (part.density?.BYTES_PER_ELEMENT ?? 0));
    const end = Math.min(part.blocks, upload.done + UPLOAD_BLOCKS);
    const start = firstSlot[part.level] + part.first;
    const put = (place: Triple, format: number, type: number, data: ArrayBufferView) => {
      const [x, y, z] = place.map((slots) => slots * slot);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, x, y, z, part.side, part.side, part.side, format, type, data);
    };
    const { density, color } = part;
    if (density) {
      bind(this.density);
      const type = density instanceof Float32Array ? gl.FLOAT : gl.HALF_FLOAT;
      for (let block = upload.done; block < end; block++) {
        put(slotPlace(this.plan, start + block), gl.RED, type, density.subarray(block * nodes, (block + 1) * nodes));
      }
    }
    bind(this.color);
    for (let block = upload.done; block < end; block++) {
      const [x, y, z] = slotPlace(this.plan, start + block);
      for (let quad = 0; quad < quads; quad++) {
        const at = (block * quads + quad) * nodes * 4;
        put([x, y, z + quad * slots[2]], gl.RGBA, gl.HALF_FLOAT, color.subarray(at, at + nodes * 4));
      }
    }
    const bytes = (end - upload.done) * blockBytes;
    upload.done = end;
    return bytes;
  }

  /** Enters a level into the tables. */
  private enter({ level, table, skipDistances }: LevelEntry): void {
    const [nx, ny, nz] = blockCounts(this.opened.metadata.levels[level]);
    const [width, height] = this.tableSize;
    for (let x = 0; x < nx; x++) {
      for (let y = 0; y < ny; y++) {
        const row = ((this.tableStart[level] + x) * height + y) * width;
        this.tables.set(table.subarray((x * ny + y) * nz, (x * ny + y + 1) * nz), row);
      }
    }
    if (skipDistances) {
      // Colour alone shows what level 0 shows.
      const { levels } = this.opened.metadata;
      const shown = level === 0 ? levels.flatMap((other, i) => (i === 0 || !other.density ? [i] : [])) : [level];
      const count = this.macro[0] * this.macro[1] * this.macro[2];
      for (const one of shown) {
        const start = Math.floor(one / 4) * count * 4 + (one % 4);
        for (let i = 0; i < count; i++) this.skipDistanceBytes[start + 4 * i] = skipDistances[i];
      }
    }
    this.table.needsUpdate = true;
    this.skipDistances.needsUpdate = true;
    this.live.add(level);
  }
}

type Format = typeof RedFormat | typeof RGBAFormat | typeof RedIntegerFormat | typeof RGBAIntegerFormat;
type Type = typeof FloatType | typeof HalfFloatType | typeof UnsignedIntType | typeof UnsignedByteType;

function volume(
  data: Float32Array | Uint32Array | Uint8Array | null,
  [width, height, depth]: Triple,
  format: Format,
  type: Type,
  internal?: "R32UI" | "RGBA8UI",
): Data3DTexture {
  const texture = new Data3DTexture(data as never, width, height, depth);
  texture.format = format as never;
  texture.type = type;
  if (internal) texture.internalFormat = internal;
  texture.wrapS = texture.wrapT = texture.wrapR = ClampToEdgeWrapping;
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 1;
  texture.needsUpdate = true;
  return texture;
}
