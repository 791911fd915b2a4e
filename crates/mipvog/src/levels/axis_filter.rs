//! The filter from one level to the next. Rows are summed along y as planes come, then planes along
//! x, then values along z.

use std::collections::VecDeque;
use std::ops::Range;

use multiversion::multiversion;

use super::required::LevelTaps;
use crate::model::grid::{NodeMask, row};

/// Bytes of the rows that are processed together, so that they and their inputs fit into the
/// caches.
const BAND_BYTES: usize = 64 << 10;
/// Shorter gaps between required output nodes are computed too, because splitting the loop costs
/// more.
const BRIDGED_NODES: usize = 16;

/// Planes between two levels.
pub(super) struct AxisFilter<'a> {
    pub(super) taps: &'a LevelTaps,
    /// The required nodes of the coarser level.
    pub(super) outputs: &'a NodeMask,
    /// Number of the first plane in `ring`.
    pub(super) ring_first: usize,
    /// Planes filtered along y, `[plane][channel]`.
    pub(super) ring: VecDeque<Vec<Vec<f32>>>,
    /// Output planes already made.
    pub(super) made: usize,
}

/// The output nodes that read a plane of the finer level.
pub(super) struct Readers {
    /// Rows of bits, at the coarser level's size.
    rows: Vec<u64>,
    /// For each row of the plane, the range along z of all nodes that are read; may be empty.
    pub(super) read: Vec<Range<usize>>,
}

impl AxisFilter<'_> {
    /// The output nodes that read plane `x` of the finer level.
    pub(super) fn readers(&self, x: usize) -> Readers {
        let rows = self.taps.reader_rows(x, self.outputs);
        let [_, y_taps, z_taps] = &self.taps.axes;
        let words = self.outputs.row_words();
        let mut merged = vec![0; words];
        let read = |y: usize| {
            merged.fill(0);
            let (start, end) = y_taps.readers(y);
            for readers in rows[start * words..end * words].chunks_exact(words) {
                row::or_into(&mut merged, readers);
            }
            row::spans(&merged, z_taps.outputs(), usize::MAX / 2).next().map_or(
                0..0,
                |(start, end)| {
                    let (low, high) = z_taps.inputs_of(start, end);
                    // Loops are extended to whole vectors.
                    low..(high + row::LANES).min(z_taps.inputs())
                },
            )
        };
        let read = (0..y_taps.inputs()).map(read).collect();
        Readers { rows, read }
    }

    /// Planes that have come so far.
    pub(super) fn fed(&self) -> usize {
        self.ring_first + self.ring.len()
    }

    /// Sums the ring along x, and then along z, into output plane `x` of one channel.
    pub(super) fn sum_planes(&self, x: usize, channel: usize, out: &mut [f32]) {
        let [x_taps, _, z_taps] = &self.taps.axes;
        let (first, weights) = x_taps.window(x);
        let nz = z_taps.inputs();
        let mut sums = vec![0.0; nz];
        for (y, out) in out.chunks_exact_mut(z_taps.outputs()).enumerate() {
            for (start, end) in row::spans(self.outputs.row(x, y), out.len(), BRIDGED_NODES) {
                let (low, high) = z_taps.padded_inputs_of(start, end);
                let sums = &mut sums[low..high];
                let row = |plane: usize| {
                    let ring = &self.ring[first + plane - self.ring_first][channel];
                    &ring[y * nz + low..y * nz + high]
                };
                sum_rows(weights, row, sums);
                z_taps.apply(sums, low, start, &mut out[start..end]);
            }
            for (start, end) in row::gaps(self.outputs.row(x, y), out.len()) {
                out[start..end].fill(0.0);
            }
        }
    }

    /// Filters one channel of a plane of the finer level along y, where `readers` read it. A few
    /// rows at a time, right after `fill(rows, plane)` has made them, while they are in a
    /// processor's cache.
    pub(super) fn filter_plane(
        &self,
        readers: &Readers,
        plane: &mut [f32],
        out: &mut [f32],
        mut fill: impl FnMut(Range<usize>, &mut [f32]),
    ) {
        let readers = &readers.rows;
        if readers.iter().all(|&word| word == 0) {
            return;
        }
        let [_, y_taps, z_taps] = &self.taps.axes;
        let (ny, nz) = (y_taps.inputs(), z_taps.inputs());
        let words = self.outputs.row_words();
        let mut made = 0;
        let rows = (BAND_BYTES / (4 * nz)).max(1);
        for start in (0..ny).step_by(rows) {
            let end = ny.min(start + rows);
            fill(start..end, plane);
            let ready = y_taps.ready(end);
            for y in made..ready {
                let (first, weights) = y_taps.window(y);
                let readers = &readers[y * words..][..words];
                for (start, end) in row::spans(readers, z_taps.outputs(), BRIDGED_NODES) {
                    let (low, high) = z_taps.padded_inputs_of(start, end);
                    let row = |row: usize| &plane[(first + row) * nz..][low..high];
                    sum_rows(weights, row, &mut out[y * nz..][low..high]);
                }
            }
            made = ready;
        }
    }
}

/// The type to which a sum is rounded.
trait Rounded: Copy {
    /// The nearest one.
    fn of(sum: f64) -> Self;
}

impl Rounded for f64 {
    #[inline(always)]
    fn of(sum: f64) -> Self {
        sum
    }
}

impl Rounded for f32 {
    #[inline(always)]
    fn of(sum: f64) -> Self {
        sum as f32
    }
}

/// Sums rows times weights in f64, in their order. Rows of weight 0 are not requested.
#[inline(always)]
fn sum_rows<'a, T: Rounded>(weights: &[f64], row: impl Fn(usize) -> &'a [f32], sums: &mut [T]) {
    let mut weighted =
        weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0).map(|(i, &w)| (row(i), w));
    // Four at once, as many as the default filter has, so that sums stay in registers.
    match (weighted.next(), weighted.next(), weighted.next(), weighted.next()) {
        (None, ..) => sums.fill(T::of(0.0)),
        (Some(a), None, ..) => sum_scaled([a], sums),
        (Some(a), Some(b), None, _) => sum_scaled([a, b], sums),
        (Some(a), Some(b), Some(c), None) => sum_scaled([a, b, c], sums),
        (Some(a), Some(b), Some(c), Some(d)) => match weighted.next() {
            None => sum_scaled([a, b, c, d], sums),
            Some(e) => {
                let mut all = vec![0.0; sums.len()];
                sum_scaled([a, b, c, d], &mut all);
                add_scaled(e, &mut all);
                weighted.for_each(|row| add_scaled(row, &mut all));
                sums.iter_mut().zip(all).for_each(|(sum, all)| *sum = T::of(all));
            }
        },
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn sum_scaled<T: Rounded, const N: usize>(rows: [(&[f32], f64); N], sums: &mut [T]) {
    let rows = rows.map(|(row, weight)| (&row[..sums.len()], weight));
    for (i, sum) in sums.iter_mut().enumerate() {
        let add = |sum, (row, weight): &(&[f32], f64)| sum + weight * f64::from(row[i]);
        *sum = T::of(rows.iter().fold(0.0, add));
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_scaled((row, weight): (&[f32], f64), sums: &mut [f64]) {
    for (sum, &value) in sums.iter_mut().zip(row) {
        *sum += weight * f64::from(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_one_row_after_the_other() {
        for count in 0..8 {
            let rows: Vec<Vec<f32>> = (0..count)
                .map(|row| (0..37).map(|i| ((row * 37 + i) as f32 * 0.73).sin()).collect())
                .collect();
            let weights: Vec<f64> =
                (0..count).map(|row| if row == 2 { 0.0 } else { 0.3 - row as f64 }).collect();
            let (mut rounded, mut whole) = ([1.0f32; 37], [1.0f64; 37]);
            sum_rows(&weights, |row| &rows[row], &mut rounded);
            sum_rows(&weights, |row| &rows[row], &mut whole);
            for i in 0..37 {
                let add = |sum, (row, weight): (&Vec<f32>, &f64)| sum + weight * f64::from(row[i]);
                let want = rows.iter().zip(&weights).fold(0.0, add);
                assert_eq!((rounded[i], whole[i]), (want as f32, want), "{count} rows");
            }
        }
    }
}
