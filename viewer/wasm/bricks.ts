/**
 * Bricks of codes of one byte: blocks with aprons, as `../src/load/bricks.ts` makes them, which is the plain form.
 *
 * In AssemblyScript. `frames` holds, of each block and its 7 upper neighbours, the number of the frame in `codes`, or -1. The
 * bits of a neighbour's number say along which axes it is the next one: 4 for x, 2 for y and 1 for z.
 */

/** Bytes of what a lane is described by: where its codes start, bytes from frame to frame, its table, and what is empty. */
const LANE: usize = 16;

/** Writes densities, one value a texel. `table` holds a value for each code, `empty` that of blocks without a frame. */
export function densities(blocks: i32, edge: i32, frames: usize, codes: usize, table: usize, empty: usize, zeros: usize, out: usize): void {
  const side = edge + 1;
  const nodes = edge * edge * edge;
  for (let block = 0; block < blocks; block++) {
    for (let corner = 0; corner < 8; corner++) {
      const frame = load<i32>(frames + (<usize>(8 * block + corner) << 2));
      const from = frame < 0 ? zeros : codes + <usize>(frame * nodes);
      const values = frame < 0 ? empty : table;
      const cx = corner & 4 ? 1 : edge;
      const cy = corner & 2 ? 1 : edge;
      const cz = corner & 1 ? 1 : edge;
      const start = block * side * side * side + firstTexel(corner, edge);
      for (let x = 0; x < cx; x++) {
        for (let y = 0; y < cy; y++) {
          let node = from + <usize>((x * edge + y) * edge);
          let to = out + (<usize>(start + (x * side + y) * side) << 2);
          for (const end = node + <usize>cz; node < end; node++, to += 4) {
            store<f32>(to, load<f32>(values + (<usize>load<u8>(node) << 2)));
          }
        }
      }
    }
  }
}

/**
 * Writes colours, four halves a texel: bricks of the first four lanes, block by block, then those of the next four. `lanes`
 * describes the channels; those that there are not have no bytes from frame to frame.
 */
export function colors(blocks: i32, edge: i32, quads: i32, frames: usize, lanes: usize, zeros: usize, out: usize): void {
  const side = edge + 1;
  for (let block = 0; block < blocks; block++) {
    for (let corner = 0; corner < 8; corner++) {
      const frame = load<i32>(frames + (<usize>(8 * block + corner) << 2));
      for (let quad = 0; quad < quads; quad++) {
        const start = (quad * blocks + block) * side * side * side + firstTexel(corner, edge);
        colorBox(frame, corner, edge, lanes + <usize>(4 * quad) * LANE, zeros, out + (<usize>start << 3));
      }
    }
  }
}

/** The texel of a brick where the nodes of a neighbour start. */
// @ts-ignore: decorator
@inline
function firstTexel(corner: i32, edge: i32): i32 {
  const side = edge + 1;
  return (((corner >> 2) * side + ((corner >> 1) & 1)) * side + (corner & 1)) * edge;
}

function colorBox(frame: i32, corner: i32, edge: i32, lanes: usize, zeros: usize, out: usize): void {
  const c0 = codesOf(frame, lanes, zeros);
  const c1 = codesOf(frame, lanes + LANE, zeros);
  const c2 = codesOf(frame, lanes + 2 * LANE, zeros);
  const c3 = codesOf(frame, lanes + 3 * LANE, zeros);
  const t0 = tableOf(frame, lanes);
  const t1 = tableOf(frame, lanes + LANE);
  const t2 = tableOf(frame, lanes + 2 * LANE);
  const t3 = tableOf(frame, lanes + 3 * LANE);
  const side = edge + 1;
  const cx = corner & 4 ? 1 : edge;
  const cy = corner & 2 ? 1 : edge;
  const cz = corner & 1 ? 1 : edge;
  for (let x = 0; x < cx; x++) {
    for (let y = 0; y < cy; y++) {
      let node = <usize>((x * edge + y) * edge);
      let to = out + (<usize>((x * side + y) * side) << 3);
      for (const end = node + <usize>cz; node < end; node++, to += 8) {
        const low = half(t0, c0 + node) | (half(t1, c1 + node) << 16);
        const high = half(t2, c2 + node) | (half(t3, c3 + node) << 16);
        store<u32>(to, low);
        store<u32>(to, high, 4);
      }
    }
  }
}

// @ts-ignore: decorator
@inline
function codesOf(frame: i32, lane: usize, zeros: usize): usize {
  return frame < 0 ? zeros : <usize>load<u32>(lane) + <usize>frame * <usize>load<u32>(lane, 4);
}

// @ts-ignore: decorator
@inline
function tableOf(frame: i32, lane: usize): usize {
  return frame < 0 ? <usize>load<u32>(lane, 12) : <usize>load<u32>(lane, 8);
}

// @ts-ignore: decorator
@inline
function half(table: usize, code: usize): u32 {
  return <u32>load<u16>(table + (<usize>load<u8>(code) << 1));
}
