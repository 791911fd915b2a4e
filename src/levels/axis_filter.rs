//! The filter from one level to the next. Rows are summed along y as planes come, then planes along
//! x, then values along z.

use std::collections::VecDeque;
use std::ops::Range;

use multiversion::multiversion;

use super::required::LevelTaps;
use crate::model::grid::{NodeMask, row};

/// Bytes of the rows that are worked on together. The caches have room for their inputs too.
const BAND_BYTES: usize = 64 << 10;
/// Shorter gaps between required output nodes are computed too: splitting the loop costs more.
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

impl AxisFilter<'_> {
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

    /// Filters one channel of a plane of the finer level along y, where the output nodes in
    /// `readers` read it. Some rows at a time, as soon as `fill(rows, plane)` has made those: they
    /// are then still in a processor's cache.
    pub(super) fn filter_plane(
        &self,
        readers: &[u64],
        plane: &mut [f32],
        out: &mut [f32],
        mut fill: impl FnMut(Range<usize>, &mut [f32]),
    ) {
        if readers.iter().all(|&word| word == 0) {
            return;
        }
        let [_, y_taps, z_taps] = &self.taps.axes;
        let (ny, nz) = (y_taps.inputs(), z_taps.inputs());
        let words = self.outputs.row_words();
        let mut sums = vec![0.0; nz];
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
                    let sums = &mut sums[low..high];
                    let row = |row: usize| &plane[(first + row) * nz..][low..high];
                    sum_rows(weights, row, sums);
                    round_to_f32(sums, &mut out[y * nz..][low..high]);
                }
            }
            made = ready;
        }
    }
}

/// Sums rows times weights, in their order. Rows without weight are not asked for.
#[inline(always)]
fn sum_rows<'a>(weights: &[f64], row: impl Fn(usize) -> &'a [f32], sums: &mut [f64]) {
    sums.fill(0.0);
    let mut weighted =
        weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0).map(|(i, &w)| (row(i), w));
    while let Some(first) = weighted.next() {
        // Four at once, as many as the default filter has: sums then stay in registers.
        match (weighted.next(), weighted.next(), weighted.next()) {
            (Some(second), Some(third), Some(fourth)) => {
                add_scaled([first, second, third, fourth], sums);
            }
            (Some(second), Some(third), None) => add_scaled([first, second, third], sums),
            (Some(second), ..) => add_scaled([first, second], sums),
            (None, ..) => add_scaled([first], sums),
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_scaled<const N: usize>(rows: [(&[f32], f64); N], sums: &mut [f64]) {
    let rows = rows.map(|(row, weight)| (&row[..sums.len()], weight));
    for (i, sum) in sums.iter_mut().enumerate() {
        let add = |sum, (row, weight): &(&[f32], f64)| sum + weight * f64::from(row[i]);
        *sum = rows.iter().fold(*sum, add);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn round_to_f32(sums: &[f64], out: &mut [f32]) {
    for (out, &sum) in out.iter_mut().zip(sums) {
        *out = sum as f32;
    }
}
