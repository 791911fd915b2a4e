//! Channels of a trained field whose nodes are rows.

use std::sync::Arc;

use super::array::RowArray;
use super::index::Index;
use super::slab::{Plane, Slabs};
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::field::NodeValues;
use crate::model::grid::{Nodes, row};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// The meaning of a channel: a weighted sum of consecutive columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    first: usize,
    weights: Vec<f32>,
    /// Converts a coefficient of band 0 alone to a colour.
    band_0: Option<Harmonics>,
}

impl Channel {
    /// A column of the rows, unchanged.
    pub fn column(column: usize) -> Self {
        Self { first: column, weights: vec![1.0], band_0: None }
    }

    /// The value of a weighted sum.
    fn value(&self, sum: f32) -> f32 {
        match self.band_0 {
            None => sum,
            Some(rules) => {
                let [value, _, _] = rules.color(&[BAND_0; FUNCTIONS], &[sum; 3]);
                value
            }
        }
    }

    /// The channels of harmonics, function by function, each red, green and blue. Rows hold
    /// `stored` functions of red, then of green, then of blue, starting at column `first`; each row
    /// of `weights` gives one harmonic.
    pub fn of_weights(first: usize, stored: usize, weights: &[Vec<f32>]) -> Vec<Self> {
        let of_function = |weights: &Vec<f32>| {
            let weights = weights.clone();
            [0, 1, 2].map(|color| {
                // For a single column, its neighbours need not be read.
                let single = weights.iter().filter(|weight| **weight != 0.0).count() == 1;
                let at = weights.iter().position(|weight| *weight != 0.0).unwrap_or(0);
                let (skip, weights) = match (single, weights.get(at)) {
                    (true, Some(&weight)) => (at, vec![weight]),
                    _ => (0, weights.clone()),
                };
                Self { first: first + color * stored + skip, weights, band_0: None }
            })
        };
        weights.iter().flat_map(of_function).collect()
    }

    /// The same if the first `kept` of the functions are harmonics.
    pub fn of_harmonics(first: usize, stored: usize, kept: usize) -> Vec<Self> {
        let of_function = |function| (0..3).map(move |color| first + color * stored + function);
        (0..kept).flat_map(of_function).map(Self::column).collect()
    }

    /// View-independent colours from the channels of band 0.
    pub fn of_band_0(channels: Vec<Self>, rules: Harmonics) -> Vec<Self> {
        let rules = Harmonics { degree: 0, ..rules };
        let band_0 = channels.into_iter().take(3);
        band_0.map(|channel| Self { band_0: Some(rules), ..channel }).collect()
    }
}

/// Channels whose nodes are rows behind an index. Nodes without a row have the values of a row of
/// zeros.
#[derive(Debug)]
pub struct RowGrid {
    index: Arc<Index>,
    array: Arc<RowArray>,
    channels: Vec<Channel>,
    /// Nodes beyond each face of the index, which repeat the face's.
    border: usize,
    /// Arrays without checksums in the file's digest.
    unchecked: Vec<Arc<RowArray>>,
    slabs: Slabs,
}

impl RowGrid {
    /// From `array`, whose rows hold the columns of all `channels`. The field has `border` more
    /// nodes beyond each face, which repeat the face's. A digest samples the arrays `unchecked`:
    /// all arrays of the field, if the file's own digest has no checksums of values.
    pub fn new(
        index: &Arc<Index>,
        array: &Arc<RowArray>,
        channels: Vec<Channel>,
        border: usize,
        unchecked: Vec<Arc<RowArray>>,
    ) -> Self {
        let slabs = Slabs::new(index, array, false);
        let (index, array) = (Arc::clone(index), Arc::clone(array));
        Self { index, array, channels, border, unchecked, slabs }
    }

    /// The same, but nodes without a row take the mean of their neighbours' rows.
    #[must_use]
    pub fn dilated(mut self) -> Self {
        self.slabs = Slabs::new(&self.index, &self.array, true);
        self
    }
}

/// Workspace of weighted sums.
#[derive(Debug, Default)]
struct WeightedSums {
    total: Vec<f32>,
    values: Vec<f32>,
}

impl NodeValues for RowGrid {
    fn nodes(&self) -> Nodes {
        Nodes(self.index.nodes().0.map(|size| size + 2 * self.border))
    }

    fn channels(&self) -> usize {
        self.channels.len()
    }

    fn memory_bytes(&self) -> u64 {
        let inflated = self.index.memory_bytes() + self.array.memory_bytes();
        self.slabs.memory_bytes(&self.index) + inflated
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        if !self.unchecked.is_empty() {
            self.index.digest(hash)?;
        }
        self.unchecked.iter().try_for_each(|array| array.sample(hash))
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        Ok(())
    }

    fn release(&self) {
        self.slabs.release();
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let [nx, ny, nz] = self.index.nodes().0;
        let Nodes([_, _, outer_nz]) = self.nodes();
        let Some(channel) = self.channels.get(channel) else { return Ok(0) };
        let words = outer_nz.div_ceil(64);
        let empty = channel.value(0.0);
        for (row, out) in region.chunks_exact(words).zip(out.chunks_exact_mut(outer_nz)) {
            for (start, end) in row::runs(row) {
                if let Some(out) = out.get_mut(start..end) {
                    out.fill(empty);
                }
            }
        }
        if region.iter().all(|&word| word == 0) {
            return Ok(0);
        }
        if self.border > 0 {
            // The border repeats the faces, in the region or not.
            let (first, last) = (self.border, self.border + nz - 1);
            for (y, row) in (0..).zip(out.chunks_exact_mut(outer_nz)) {
                let is_face = y == self.border || y + 1 == self.border + ny;
                let (start, end) = if is_face { (0, outer_nz) } else { (first, first + 1) };
                for (start, end) in [(start, end), (last, last + 1)] {
                    if let Some(part) = row.get_mut(start..end) {
                        part.fill(empty);
                    }
                }
            }
        }
        let inner = x.saturating_sub(self.border).min(nx - 1);
        let bytes = self.slabs.with_plane(&self.index, &self.array, inner, |plane| {
            match plane.is_full && self.border == 0 {
                true => self.read_runs(channel, plane, region, out),
                false => self.read_all(channel, plane, out),
            }
        })?;
        if self.border > 0 {
            self.repeat_faces(out, [ny, nz]);
        }
        Ok(bytes)
    }
}

impl RowGrid {
    /// The values of a plane at the nodes of a region, where every node has a row.
    fn read_runs(&self, channel: &Channel, plane: &Plane, region: &[u64], out: &mut [f32]) {
        let Nodes([_, _, nz]) = self.index.nodes();
        let size = self.array.row_bytes();
        let mut sums = WeightedSums::default();
        let rows = plane.rows.chunks_exact(nz * size).zip(out.chunks_exact_mut(nz));
        for (region, (rows, out)) in region.chunks_exact(nz.div_ceil(64)).zip(rows) {
            for (start, end) in row::runs(region) {
                let rows = rows.get(start * size..end * size).unwrap_or_default();
                let out = out.get_mut(start..end).unwrap_or_default();
                for (out, value) in out.iter_mut().zip(self.values(channel, rows, &mut sums)) {
                    *out = channel.value(*value);
                }
            }
        }
    }

    /// The values of a plane at all nodes that have a row.
    fn read_all(&self, channel: &Channel, plane: &Plane, out: &mut [f32]) {
        let Nodes([_, ny, nz]) = self.index.nodes();
        let Nodes([_, _, outer_nz]) = self.nodes();
        let mut sums = WeightedSums::default();
        let values = self.values(channel, &plane.rows, &mut sums);
        let all = 0..if plane.is_full { ny * nz } else { 0 };
        let nodes = plane.nodes.iter().map(|node| *node as usize).chain(all);
        // Nodes ascend, so rows end one after the other.
        let (mut row_end, mut shift) = (nz, self.border * outer_nz + self.border);
        for (node, value) in nodes.zip(values) {
            while node >= row_end {
                row_end += nz;
                shift += outer_nz - nz;
            }
            if let Some(out) = out.get_mut(node + shift) {
                *out = channel.value(*value);
            }
        }
    }

    /// The weighted sums of a channel, of these rows.
    fn values<'a>(&self, channel: &Channel, rows: &[u8], sums: &'a mut WeightedSums) -> &'a [f32] {
        let WeightedSums { total, values } = sums;
        for (number, (column, &weight)) in (channel.first..).zip(&channel.weights).enumerate() {
            let out = if number == 0 { &mut *total } else { &mut *values };
            self.slabs.column(&self.array, rows, column, out);
            if weight != 1.0 {
                out.iter_mut().for_each(|value| *value *= weight);
            }
            if number > 0 {
                total.iter_mut().zip(&*values).for_each(|(sum, value)| *sum += value);
            }
        }
        total
    }

    /// Copies the outermost nodes of the index's plane to the border around it.
    fn repeat_faces(&self, out: &mut [f32], [ny, nz]: [usize; 2]) {
        let (border, width) = (self.border, nz + 2 * self.border);
        for row in out.chunks_exact_mut(width).skip(border).take(ny) {
            row.copy_within(border..border + 1, 0);
            for at in 1..border {
                row.copy_within(..1, at);
            }
            for at in border + nz..width {
                row.copy_within(border + nz - 1..border + nz, at);
            }
        }
        for y in (0..border).chain(border + ny..ny + 2 * border) {
            let from = y.clamp(border, border + ny - 1);
            out.copy_within(from * width..(from + 1) * width, y * width);
        }
    }
}
