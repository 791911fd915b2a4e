/**
 * Skip distances of macro cells, 16 cells at a time: the two sweeps of `../src/load/skip.ts`, which is the plain form.
 *
 * In AssemblyScript, with the vectors of WebAssembly.
 */

/** Cells that are looked at together: bytes of a vector. */
const LANES: usize = 16;
const FAR = i8x16.splat(-1);

/** From 0 and 255 of each of `nx * ny * nz` cells to their distances. `scratch` is memory of `scratchBytes`. */
export function distances(cells: usize, nx: i32, ny: i32, nz: i32, scratch: usize): void {
  const count = <usize>(nx * ny * nz);
  sweep(cells, nx, ny, nz, scratch);
  reverse(cells, count);
  sweep(cells, nx, ny, nz, scratch);
  reverse(cells, count);
}

export function scratchBytes(ny: i32, nz: i32): usize {
  return (2 * <usize>ny + 1) * rowBytes(nz) + 2 * LANES;
}

/** Bytes of a row in whole vectors. */
// @ts-ignore: decorator
@inline
function rowBytes(nz: i32): usize {
  return (<usize>nz + LANES - 1) & ~(LANES - 1);
}

/** Each cell's least distance by way of the cells that lie before it. */
function sweep(cells: usize, nx: i32, ny: i32, nz: i32, scratch: usize): void {
  const wide = rowBytes(nz);
  const plane = <usize>ny * wide;
  // Of the plane before, the least of each cell and its 8 neighbours; of this plane, that of its 2 along the row.
  const before = scratch;
  const rows = scratch + plane;
  // A row between vectors of cells that are far from all.
  const row = rows + plane + LANES;
  memory.fill(before, 255, plane);
  memory.fill(row - LANES, 255, wide + 2 * LANES);
  for (let x = 0; x < nx; x++) {
    for (let y = 0; y < ny; y++) {
      const at = cells + <usize>((x * ny + y) * nz);
      const here = <usize>y * wide;
      memory.copy(row, at, <usize>nz);
      along(row, wide, before + here, y > 0 ? rows + here - wide : before + here);
      memory.copy(at, row, <usize>nz);
      memory.fill(row + <usize>nz, 255, wide - <usize>nz);
      for (let z: usize = 0; z < wide; z += LANES) {
        const least = i8x16.min_u(v128.load(row + z), i8x16.min_u(v128.load(row + z - 1), v128.load(row + z + 1)));
        v128.store(rows + here + z, least);
      }
    }
    for (let y = 0; y < ny; y++) {
      const here = <usize>y * wide;
      for (let z = here; z < here + wide; z += LANES) {
        let least = v128.load(rows + z);
        if (y > 0) least = i8x16.min_u(least, v128.load(rows + z - wide));
        if (y + 1 < ny) least = i8x16.min_u(least, v128.load(rows + z + wide));
        v128.store(before + z, least);
      }
    }
  }
}

/** The distances of a row by way of what lies before it, in two places, and then of the cells before each in the row. */
function along(row: usize, wide: usize, before: usize, beside: usize): void {
  let last = FAR;
  for (let z: usize = 0; z < wide; z += LANES) {
    let least = v128.load(row + z);
    least = i8x16.min_u(least, farther(i8x16.min_u(v128.load(before + z), v128.load(beside + z)), 1));
    // Of all cells before it in the vector: those of 1, then 3, then 7, then 15.
    least = i8x16.min_u(least, farther(v128.shuffle<i8>(FAR, least, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30), 1));
    least = i8x16.min_u(least, farther(v128.shuffle<i8>(FAR, least, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29), 2));
    least = i8x16.min_u(least, farther(v128.shuffle<i8>(FAR, least, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27), 4));
    least = i8x16.min_u(least, farther(v128.shuffle<i8>(FAR, least, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23), 8));
    least = i8x16.min_u(least, i8x16.add_sat_u(last, i8x16(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16)));
    v128.store(row + z, least);
    last = i8x16.splat(i8x16.extract_lane_u(least, 15));
  }
}

// @ts-ignore: decorator
@inline
function farther(distances: v128, by: i8): v128 {
  return i8x16.add_sat_u(distances, i8x16.splat(by));
}

function reverse(cells: usize, count: usize): void {
  let low = cells;
  let high = cells + count;
  for (; low + 2 * LANES <= high; low += LANES) {
    high -= LANES;
    const first = v128.load(low);
    v128.store(low, backwards(v128.load(high)));
    v128.store(high, backwards(first));
  }
  for (high--; low < high; low++, high--) {
    const first = load<u8>(low);
    store<u8>(low, load<u8>(high));
    store<u8>(high, first);
  }
}

// @ts-ignore: decorator
@inline
function backwards(bytes: v128): v128 {
  return v128.shuffle<i8>(bytes, bytes, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
}
