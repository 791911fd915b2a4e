//! Transposes numbers of several blocks between block order and node order.
//!
//! Rows hold one block each, lanes the same node of `L` blocks, a power of two. Tiles of eight
//! nodes are transposed at a time, in steps. Each step interleaves two halves, which moves the
//! first bit of an index to the end. Vectors have instructions for this, while strided access reads
//! one number at a time.

use multiversion::multiversion;

use super::code_word::Code;

/// Nodes of a tile.
const TILE: usize = 8;
/// Tiles of a row that are read or written at once: whole cache lines. Rows are often a power of
/// two apart, so that lines of different rows evict each other from a cache.
const TILES: usize = 8;

/// Transposes rows to lanes. There are at most `L` rows, each as long as `lanes`; lanes without a
/// row do not change.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn spread<T: Code, const L: usize>(rows: &[&[T]], lanes: &mut [[T; L]]) {
    let mut tiles = [[[T::default(); TILE]; TILES]; L];
    for (i, lanes) in lanes.chunks_mut(TILES * TILE).enumerate() {
        for (tiles, row) in tiles.iter_mut().zip(rows) {
            let (tiles, row) = (tiles.as_flattened_mut(), &row[i * TILES * TILE..]);
            match row.first_chunk::<{ TILES * TILE }>() {
                Some(whole) => tiles.copy_from_slice(whole),
                None => tiles[..row.len()].copy_from_slice(row),
            }
        }
        for (at, lanes) in lanes.chunks_mut(TILE).enumerate() {
            match lanes.as_chunks_mut::<TILE>() {
                ([lanes], _) => to_lanes(&tiles, at, lanes),
                (_, lanes) => {
                    let mut whole = [[T::default(); L]; TILE];
                    to_lanes(&tiles, at, &mut whole);
                    lanes.copy_from_slice(&whole[..lanes.len()]);
                }
            }
        }
    }
}

/// Transposes lanes to at most `L` rows of `nodes` numbers, `stride` apart.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn gather<T: Code, const L: usize>(
    lanes: &[[T; L]],
    rows: &mut [T],
    stride: usize,
    nodes: usize,
) {
    let mut tiles = [[[T::default(); TILE]; TILES]; L];
    for (i, lanes) in lanes.chunks(TILES * TILE).enumerate() {
        for (at, lanes) in lanes.chunks(TILE).enumerate() {
            match lanes.as_chunks::<TILE>() {
                ([lanes], _) => to_rows(lanes, &mut tiles, at),
                (_, lanes) => {
                    let mut whole = [[T::default(); L]; TILE];
                    whole[..lanes.len()].copy_from_slice(lanes);
                    to_rows(&whole, &mut tiles, at);
                }
            }
        }
        for (tiles, row) in tiles.iter().zip(rows.chunks_mut(stride)) {
            let row = &mut row[i * TILES * TILE..nodes];
            match row.first_chunk_mut::<{ TILES * TILE }>() {
                Some(whole) => whole.copy_from_slice(tiles.as_flattened()),
                None => row.copy_from_slice(&tiles.as_flattened()[..row.len()]),
            }
        }
    }
}

#[inline(always)]
fn to_lanes<T: Code, const L: usize>(
    rows: &[[[T; TILE]; TILES]; L],
    at: usize,
    lanes: &mut [[T; L]; TILE],
) {
    const { assert!(L.is_power_of_two()) }
    let [mut tile, mut spare] = [[[T::default(); TILE]; L]; 2];
    for (tile, row) in tile.iter_mut().zip(rows) {
        *tile = row[at];
    }
    let turned = turn(tile.as_flattened_mut(), spare.as_flattened_mut(), L.ilog2());
    lanes.as_flattened_mut().copy_from_slice(turned);
}

#[inline(always)]
fn to_rows<T: Code, const L: usize>(
    lanes: &[[T; L]; TILE],
    rows: &mut [[[T; TILE]; TILES]; L],
    at: usize,
) {
    let [mut tile, mut spare] = [*lanes; 2];
    let turned = turn(tile.as_flattened_mut(), spare.as_flattened_mut(), TILE.ilog2());
    for (row, tile) in rows.iter_mut().zip(turned.as_chunks().0) {
        row[at] = *tile;
    }
}

/// Rotates the index bits of each number by this many places. The result is in the tile or in its
/// spare.
#[inline(always)]
fn turn<'a, T: Copy>(mut tile: &'a mut [T], mut spare: &'a mut [T], digits: u32) -> &'a [T] {
    for _ in 0..digits {
        let (low, high) = tile.split_at(tile.len() / 2);
        for (pair, (low, high)) in spare.as_chunks_mut().0.iter_mut().zip(low.iter().zip(high)) {
            *pair = [*low, *high];
        }
        (tile, spare) = (spare, tile);
    }
    tile
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_are_rows_turned() {
        for (nodes, rows) in [(1, 1), (7, 4), (8, 3), (27, 4), (64, 2), (131, 3), (512, 4)] {
            let numbers: Vec<u16> = (0..nodes * rows).map(|i| i as u16).collect();
            let mut lanes = vec![[u16::MAX; 4]; nodes];
            let all: Vec<&[u16]> = numbers.chunks(nodes).collect();
            spread(&all, &mut lanes);
            for (node, lanes) in lanes.iter().enumerate() {
                for (row, &number) in lanes[..rows].iter().enumerate() {
                    assert_eq!(usize::from(number), row * nodes + node);
                }
            }
            let stride = nodes + 3;
            let mut back = vec![u16::MAX; (rows - 1) * stride + nodes];
            gather(&lanes, &mut back, stride, nodes);
            for (i, &number) in back.iter().enumerate() {
                let inside = i % stride < nodes;
                let want = if inside { numbers[i / stride * nodes + i % stride] } else { u16::MAX };
                assert_eq!(number, want);
            }
        }
    }
}
