/**
 * The rule of section 5 of `formats/mipvog.md` for codes of one byte, for the same node of 8 blocks at a time.
 *
 * In AssemblyScript, with the vectors of WebAssembly: lanes of 16 bits, one for each block. A node is predicted from nodes
 * before it, so one block alone is no work for vectors. `../src/format/codings/restore.ts` is the plain form, also for pages
 * that may not run WebAssembly.
 */

/** Blocks that are restored at once. */
const LANES: i32 = 8;
/** Bytes of a vector. */
const VECTOR: usize = 16;
/** Bytes of the weights of a mode and channel: five, and three of nothing. */
const WEIGHTS: usize = 8;
/** What residuals are stored above. */
const BIAS: i32 = 0x80;
/** A third in 15 bits: a number less 1, times this and rounded, is the number's third rounded down, up to 765. */
const THIRD: i16 = 10923;

// Weights of a channel by block, in pairs as products are summed: of blocks 0 to 3, and of blocks 4 to 7.
let slopesLow: v128 = i16x8.splat(0);
let slopesHigh: v128 = i16x8.splat(0);
let beforeLow: v128 = i16x8.splat(0);
let beforeHigh: v128 = i16x8.splat(0);
let lastLow: v128 = i16x8.splat(0);
let lastHigh: v128 = i16x8.splat(0);

// Vectors of a node, by its place in each: the mask of nodes with a residual; residuals; codes; and differences of code and
// mean of this channel and of the three before it.
let mask: usize = 0;
let moved: usize = 0;
let codes: usize = 0;
let own: usize = 0;
let first: usize = 0;
let second: usize = 0;
let third: usize = 0;

/**
 * Restores the codes of a run from `out` on, frame by frame and channel by channel; behind them 7 frames more are
 * overwritten. Places in memory: `starts`, of each frame the number of its first residual; `modes` of frames; `weights` of
 * modes and channels; `bits` of nodes with a residual, whole bytes a frame; `scratch`, 8 vectors for each node.
 */
export function restore(frames: i32, channels: i32, edge: i32, live: i32, residuals: usize, starts: usize, modes: usize, weights: usize, bits: usize, scratch: usize, out: usize): void {
  const nodes = edge * edge * edge;
  const plane = <usize>nodes * VECTOR;
  const frameBytes = <usize>(channels * nodes);
  mask = scratch;
  moved = scratch + plane;
  codes = scratch + 2 * plane;
  for (let frame = 0; frame < frames; frame += LANES) {
    const lanes = min(LANES, frames - frame);
    memory.fill(mask, 0, plane);
    for (let lane = 0; lane < lanes; lane++) spreadBits(bits + <usize>((frame + lane) * ((nodes + 7) >> 3)), nodes, lane);
    for (let channel = 0; channel < channels; channel++) {
      own = differences(scratch, plane, channel);
      first = differences(scratch, plane, channel + 3);
      second = differences(scratch, plane, channel + 2);
      third = differences(scratch, plane, channel + 1);
      for (let lane = 0; lane < lanes; lane++) {
        const start = load<i32>(starts + (<usize>(frame + lane) << 2));
        spreadResiduals(residuals + <usize>(channel * live + start), nodes, lane);
      }
      takeWeights(modes + <usize>frame, weights + <usize>channel * WEIGHTS, <usize>channels * WEIGHTS, lanes, scratch + 7 * plane);
      restoreChannel(edge);
      gather(out + <usize>frame * frameBytes + <usize>(channel * nodes), frameBytes, nodes);
    }
  }
}

/** Where the differences of a channel are, by its number modulo 4. */
function differences(scratch: usize, plane: usize, channel: i32): usize {
  return scratch + (3 + <usize>(channel & 3)) * plane;
}

/** Writes -1 for each node of a block with a residual. */
function spreadBits(bits: usize, nodes: i32, lane: i32): void {
  let at = mask + (<usize>lane << 1);
  for (let node = 0; node < nodes; node++, at += VECTOR) {
    store<i16>(at, <i16>-((load<u8>(bits + <usize>(node >> 3)) >> <u8>(node & 7)) & 1));
  }
}

/** Writes a block's residuals to its nodes; what the others get is masked. */
function spreadResiduals(residuals: usize, nodes: i32, lane: i32): void {
  let at = <usize>lane << 1;
  let next = residuals;
  for (let node = 0; node < nodes; node++, at += VECTOR) {
    store<i16>(moved + at, <i16>(<i32>load<u8>(next) - BIAS));
    next -= <usize><isize>load<i16>(mask + at);
  }
}

/** The weights of a channel of 8 blocks; `pairs` is memory for them. */
function takeWeights(modes: usize, weights: usize, mode: usize, lanes: i32, pairs: usize): void {
  memory.fill(pairs, 0, 6 * VECTOR);
  for (let lane = 0; lane < lanes; lane++) {
    const from = weights + <usize>load<u8>(modes + <usize>lane) * mode;
    const at = pairs + (<usize>lane << 2);
    store<i16>(at, load<i8>(from));
    store<i16>(at, load<i8>(from, 1), 2);
    store<i16>(at, load<i8>(from, 2), 32);
    store<i16>(at, load<i8>(from, 3), 34);
    store<i16>(at, load<i8>(from, 4), 64);
    // Products are divided by 32, and rounded.
    store<i16>(at, 16, 66);
  }
  slopesLow = v128.load(pairs);
  slopesHigh = v128.load(pairs, 16);
  beforeLow = v128.load(pairs, 32);
  beforeHigh = v128.load(pairs, 48);
  lastLow = v128.load(pairs, 64);
  lastHigh = v128.load(pairs, 80);
}

/** Pairs of the lower, and of the upper four lanes. */
// @ts-ignore: decorator
@inline
function pairsLow(a: v128, b: v128): v128 {
  return v128.shuffle<i16>(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
}

// @ts-ignore: decorator
@inline
function pairsHigh(a: v128, b: v128): v128 {
  return v128.shuffle<i16>(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
}

/** Writes a node of 8 blocks from its mean, from the sum of its slopes and from the one across; its codes. */
// @ts-ignore: decorator
@inline
function put(at: usize, mean: v128, slopes: v128, across: v128): v128 {
  const d1 = v128.load(first + at);
  const d2 = v128.load(second + at);
  const d3 = v128.load(third + at);
  const one = i16x8.splat(1);
  let low = i32x4.add(i32x4.dot_i16x8_s(pairsLow(d1, d2), beforeLow), i32x4.dot_i16x8_s(pairsLow(d3, one), lastLow));
  let high = i32x4.add(i32x4.dot_i16x8_s(pairsHigh(d1, d2), beforeHigh), i32x4.dot_i16x8_s(pairsHigh(d3, one), lastHigh));
  low = i32x4.add(low, i32x4.dot_i16x8_s(pairsLow(slopes, across), slopesLow));
  high = i32x4.add(high, i32x4.dot_i16x8_s(pairsHigh(slopes, across), slopesHigh));
  const terms = i16x8.narrow_i32x4_s(i32x4.shr_s(low, 5), i32x4.shr_s(high, 5));
  const change = v128.and(i16x8.add(terms, v128.load(moved + at)), v128.load(mask + at));
  const code = v128.and(i16x8.add(mean, change), i16x8.splat(0xff));
  v128.store(codes + at, code);
  v128.store(own + at, i16x8.sub(code, mean));
  return code;
}

/** Restores a channel of 8 blocks. */
function restoreChannel(edge: i32): void {
  const none = i16x8.splat(0);
  const row = <usize>edge * VECTOR;
  const slab = row * <usize>edge;
  let at: usize = 0;
  for (let x = 0; x < edge; x++) {
    for (let y = 0; y < edge; y++) {
      const end = at + row;
      if (x > 0 && y > 0) {
        let up = v128.load(codes + at - slab);
        let back = v128.load(codes + at - row);
        let corner = v128.load(codes + at - slab - row);
        let mean = i16x8.shr_u(i16x8.add(up, back), 1);
        let code = put(at, mean, i16x8.sub(corner, mean), none);
        for (at += VECTOR; at < end; at += VECTOR) {
          const passed = i16x8.add(up, back);
          const across = corner;
          up = v128.load(codes + at - slab);
          back = v128.load(codes + at - row);
          corner = v128.load(codes + at - slab - row);
          const sum = i16x8.add(i16x8.add(up, back), code);
          mean = i16x8.q15mulr_sat_s(i16x8.sub(sum, i16x8.splat(1)), i16x8.splat(THIRD));
          const slopes = i16x8.sub(i16x8.add(passed, corner), i16x8.mul(mean, i16x8.splat(3)));
          code = put(at, mean, slopes, i16x8.sub(across, mean));
        }
      } else if (x > 0 || y > 0) {
        const step = x > 0 ? slab : row;
        let side = v128.load(codes + at - step);
        let code = put(at, side, none, none);
        for (at += VECTOR; at < end; at += VECTOR) {
          const passed = side;
          side = v128.load(codes + at - step);
          const mean = i16x8.shr_u(i16x8.add(side, code), 1);
          code = put(at, mean, i16x8.sub(passed, mean), none);
        }
      } else {
        // The mean of the first node is 0.
        let code = none;
        for (; at < end; at += VECTOR) code = put(at, code, none, none);
      }
    }
  }
}

/** Writes the codes of 8 blocks, each of which starts `stride` bytes behind the one before. */
function gather(out: usize, stride: usize, nodes: i32): void {
  let node = 0;
  for (; node + LANES <= nodes; node += LANES) {
    const from = codes + <usize>node * VECTOR;
    const to = out + <usize>node;
    // Blocks by nodes: eight bytes of a node lie together, and then of a block.
    const n01 = i8x16.narrow_i16x8_u(v128.load(from), v128.load(from, 16));
    const n23 = i8x16.narrow_i16x8_u(v128.load(from, 32), v128.load(from, 48));
    const n45 = i8x16.narrow_i16x8_u(v128.load(from, 64), v128.load(from, 80));
    const n67 = i8x16.narrow_i16x8_u(v128.load(from, 96), v128.load(from, 112));
    // Nodes 0 to 3 of each block, and nodes 4 to 7: of blocks 0 to 3, and of blocks 4 to 7.
    const low0 = quads(n01, n23);
    const low4 = quadsUpper(n01, n23);
    const high0 = quads(n45, n67);
    const high4 = quadsUpper(n45, n67);
    putBlocks(to, stride, v128.shuffle<i32>(low0, high0, 0, 4, 1, 5), v128.shuffle<i32>(low0, high0, 2, 6, 3, 7));
    putBlocks(to + 4 * stride, stride, v128.shuffle<i32>(low4, high4, 0, 4, 1, 5), v128.shuffle<i32>(low4, high4, 2, 6, 3, 7));
  }
  for (; node < nodes; node++) {
    for (let lane = 0; lane < LANES; lane++) {
      store<u8>(out + <usize>lane * stride + <usize>node, load<u8>(codes + <usize>node * VECTOR + (<usize>lane << 1)));
    }
  }
}

/** Of two pairs of nodes the four codes of blocks 0 to 3, and of blocks 4 to 7. */
// @ts-ignore: decorator
@inline
function quads(a: v128, b: v128): v128 {
  return v128.shuffle<i8>(a, b, 0, 8, 16, 24, 1, 9, 17, 25, 2, 10, 18, 26, 3, 11, 19, 27);
}

// @ts-ignore: decorator
@inline
function quadsUpper(a: v128, b: v128): v128 {
  return v128.shuffle<i8>(a, b, 4, 12, 20, 28, 5, 13, 21, 29, 6, 14, 22, 30, 7, 15, 23, 31);
}

/** Writes eight codes of each of four blocks. */
// @ts-ignore: decorator
@inline
function putBlocks(to: usize, stride: usize, a: v128, b: v128): void {
  v128.store_lane<i64>(to, a, 0);
  v128.store_lane<i64>(to + stride, a, 1);
  v128.store_lane<i64>(to + 2 * stride, b, 0);
  v128.store_lane<i64>(to + 3 * stride, b, 1);
}
