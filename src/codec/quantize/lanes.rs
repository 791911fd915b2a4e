//! Numbers of several blocks, block by block or node by node.
//!
//! Rows hold a block each, lanes the same node of `L` blocks. Tiles of eight nodes are turned at a
//! time, in three steps: each deals numbers into two halves by turns, or the other way round. The
//! lowest digit of a number's place becomes the highest one so. Vectors have instructions for that,
//! where strides through memory take one number at a time.

use multiversion::multiversion;

use super::code_word::Code;

/// Nodes of a tile.
const TILE: usize = 8;
/// Tiles that are written to a row at once: whole cache lines. Rows are often a power of two apart,
/// and then lines of different rows drive each other out of a cache.
const TILES: usize = 8;

/// Rows of `nodes` numbers to lanes; there are at most `L`, and lanes without a row stay.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn spread<T: Code, const L: usize>(rows: &[T], nodes: usize, lanes: &mut [[T; L]]) {
    let mut tile = [[T::default(); TILE]; L];
    for (i, lanes) in lanes.chunks_mut(TILE).enumerate() {
        for (tile, row) in tile.iter_mut().zip(rows.chunks_exact(nodes)) {
            let row = &row[i * TILE..];
            match row.first_chunk() {
                Some(whole) => *tile = *whole,
                None => tile[..row.len()].copy_from_slice(row),
            }
        }
        match lanes.as_chunks_mut::<TILE>() {
            ([lanes], _) => to_lanes(&tile, lanes),
            (_, lanes) => {
                let mut whole = [[T::default(); L]; TILE];
                to_lanes(&tile, &mut whole);
                lanes.copy_from_slice(&whole[..lanes.len()]);
            }
        }
    }
}

/// Lanes to rows of `nodes` numbers, `stride` apart; there are at most `L`.
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
fn to_lanes<T: Code, const L: usize>(rows: &[[T; TILE]; L], lanes: &mut [[T; L]; TILE]) {
    let [mut once, mut twice] = [[[T::default(); L]; TILE]; 2];
    deal(rows.as_flattened(), once.as_flattened_mut());
    deal(once.as_flattened(), twice.as_flattened_mut());
    deal(twice.as_flattened(), lanes.as_flattened_mut());
}

#[inline(always)]
fn to_rows<T: Code, const L: usize>(
    lanes: &[[T; L]; TILE],
    rows: &mut [[[T; TILE]; TILES]; L],
    at: usize,
) {
    let [mut once, mut twice, mut tile] = [[[T::default(); TILE]; L]; 3];
    collect(lanes.as_flattened(), once.as_flattened_mut());
    collect(once.as_flattened(), twice.as_flattened_mut());
    collect(twice.as_flattened(), tile.as_flattened_mut());
    for (row, tile) in rows.iter_mut().zip(tile) {
        row[at] = tile;
    }
}

/// Numbers to two halves by turns.
#[inline(always)]
fn deal<T: Copy>(numbers: &[T], dealt: &mut [T]) {
    let (low, high) = dealt.split_at_mut(numbers.len() / 2);
    for ((&[even, odd], low), high) in numbers.as_chunks().0.iter().zip(low).zip(high) {
        (*low, *high) = (even, odd);
    }
}

/// The inverse of [`deal`].
#[inline(always)]
fn collect<T: Copy>(dealt: &[T], numbers: &mut [T]) {
    let (low, high) = dealt.split_at(dealt.len() / 2);
    for (([even, odd], low), high) in numbers.as_chunks_mut().0.iter_mut().zip(low).zip(high) {
        (*even, *odd) = (*low, *high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_are_rows_turned() {
        for (nodes, rows) in [(1, 1), (7, 4), (8, 3), (27, 4), (64, 2), (131, 3), (512, 4)] {
            let numbers: Vec<u16> = (0..nodes * rows).map(|i| i as u16).collect();
            let mut lanes = vec![[u16::MAX; 4]; nodes];
            spread(&numbers, nodes, &mut lanes);
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
