/**
 * Bricks of codes of one byte, 16 nodes at a time: what `codeBricks` of `../src/load/bricks.ts` makes, which is the plain form.
 *
 * In AssemblyScript, with the vectors of WebAssembly.
 */

/** Nodes that are written together: bytes of a vector. */
const LANES: i32 = 16;

/** Writes four channels of blocks from `out` on. `lanes` has, of each channel, where its codes start and bytes from block to block. */
export function weave(blocks: i32, nodes: i32, lanes: usize, out: usize): void {
  let to = out;
  for (let block = 0; block < blocks; block++) {
    let a = lane(lanes, 0, block);
    let b = lane(lanes, 8, block);
    let c = lane(lanes, 16, block);
    let d = lane(lanes, 24, block);
    let node = 0;
    for (; node + LANES <= nodes; node += LANES) {
      const va = v128.load(a);
      const vb = v128.load(b);
      const vc = v128.load(c);
      const vd = v128.load(d);
      const abLow = v128.shuffle<i8>(va, vb, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
      const abHigh = v128.shuffle<i8>(va, vb, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
      const cdLow = v128.shuffle<i8>(vc, vd, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
      const cdHigh = v128.shuffle<i8>(vc, vd, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
      v128.store(to, v128.shuffle<i16>(abLow, cdLow, 0, 8, 1, 9, 2, 10, 3, 11));
      v128.store(to, v128.shuffle<i16>(abLow, cdLow, 4, 12, 5, 13, 6, 14, 7, 15), 16);
      v128.store(to, v128.shuffle<i16>(abHigh, cdHigh, 0, 8, 1, 9, 2, 10, 3, 11), 32);
      v128.store(to, v128.shuffle<i16>(abHigh, cdHigh, 4, 12, 5, 13, 6, 14, 7, 15), 48);
      a += LANES;
      b += LANES;
      c += LANES;
      d += LANES;
      to += 4 * LANES;
    }
    for (; node < nodes; node++) {
      store<u8>(to, load<u8>(a++));
      store<u8>(to, load<u8>(b++), 1);
      store<u8>(to, load<u8>(c++), 2);
      store<u8>(to, load<u8>(d++), 3);
      to += 4;
    }
  }
}

/** Where the codes of a block start. */
// @ts-ignore: decorator
@inline
function lane(lanes: usize, at: usize, block: i32): usize {
  return <usize>load<i32>(lanes + at) + <usize>(block * load<i32>(lanes + at, 4));
}
