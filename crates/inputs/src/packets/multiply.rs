//! The products of a layer with many inputs.

use super::real::{Lanes, Real};

/// Neurons that are summed at once; layers are padded to a multiple.
pub(super) const TILE: usize = 4;

/// Adds products of weights and inputs to sums, [`TILE`] of them at a time. `rows` are the weights'
/// own inputs of each tile, of which `inputs` are the first ones. Terms are added in order,
/// [`TILE`] inputs at a time: with one at a time, compilers vectorize over neurons, which takes
/// thirty times as long.
#[inline(always)]
pub(super) fn multiply<T: Real>(
    weights: &[T],
    rows: usize,
    inputs: &[Lanes<T>],
    sums: &mut [Lanes<T>],
) {
    let (tiles, rest) = inputs.as_chunks::<TILE>();
    let each = weights.chunks((TILE * rows).max(1));
    for (sums, weights) in sums.as_chunks_mut::<TILE>().0.iter_mut().zip(each) {
        let columns = weights.as_chunks::<TILE>().0;
        for (inputs, columns) in tiles.iter().zip(columns.as_chunks::<TILE>().0) {
            add_tile(inputs, columns, sums);
        }
        let left = columns.iter().skip(tiles.len() * TILE);
        for (input, column) in rest.iter().zip(left) {
            for (sums, weight) in sums.iter_mut().zip(column) {
                sums.iter_mut().zip(input).for_each(|(sum, value)| *sum += *weight * *value);
            }
        }
    }
}

/// Replaces negative numbers and NaN by 0.
#[inline(always)]
pub(super) fn relu<T: Real>(values: &mut [Lanes<T>]) {
    for value in values.as_flattened_mut() {
        *value = if *value > T::default() { *value } else { T::default() };
    }
}

/// Adds [`TILE`] inputs, each with its column of weights.
#[inline(always)]
fn add_tile<T: Real>(
    [in_a, in_b, in_c, in_d]: &[Lanes<T>; TILE],
    [a, b, c, d]: &[[T; TILE]; TILE],
    [sums_a, sums_b, sums_c, sums_d]: &mut [Lanes<T>; TILE],
) {
    let rows = in_a.iter().zip(in_b).zip(in_c).zip(in_d);
    let sums = sums_a.iter_mut().zip(sums_b).zip(sums_c).zip(sums_d);
    for ((((sum_a, sum_b), sum_c), sum_d), (((in_a, in_b), in_c), in_d)) in sums.zip(rows) {
        *sum_a = *sum_a + a[0] * *in_a + b[0] * *in_b + c[0] * *in_c + d[0] * *in_d;
        *sum_b = *sum_b + a[1] * *in_a + b[1] * *in_b + c[1] * *in_c + d[1] * *in_d;
        *sum_c = *sum_c + a[2] * *in_a + b[2] * *in_b + c[2] * *in_c + d[2] * *in_d;
        *sum_d = *sum_d + a[3] * *in_a + b[3] * *in_b + c[3] * *in_c + d[3] * *in_d;
    }
}
