//! Channels of a trained field whose nodes are rows.

use std::sync::Arc;

use super::array::RowArray;
use super::index::Index;
use super::slab::Slabs;
use crate::base::error::Result;
use crate::model::field::NodeValues;
use crate::model::grid::{Nodes, row};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// The meaning of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Channel {
    /// A column of the rows, as it is.
    Column(usize),
    /// The colour that a column's coefficient of band 0 makes by itself.
    Band0(usize, Harmonics),
}

impl Channel {
    fn column(self) -> usize {
        match self {
            Self::Column(column) | Self::Band0(column, _) => column,
        }
    }

    fn value(self, stored: f32) -> f32 {
        match self {
            Self::Column(_) => stored,
            Self::Band0(_, rules) => {
                let [value, _, _] = rules.color(&[BAND_0; FUNCTIONS], &[stored; 3]);
                value
            }
        }
    }

    /// The channels of harmonics whose rows hold all functions of red, then of green, then of blue,
    /// starting at a column: function by function, each red, green and blue. `stored` is the number
    /// of functions in a row, `kept` that of the field.
    pub fn of_harmonics(first: usize, stored: usize, kept: usize) -> Vec<Self> {
        let of_function = |function| (0..3).map(move |color| first + color * stored + function);
        (0..kept).flat_map(of_function).map(Self::Column).collect()
    }

    /// Colours that do not depend on the view: band 0 of the same rows.
    pub fn of_band_0(first: usize, stored: usize, rules: Harmonics) -> Vec<Self> {
        let rules = Harmonics { degree: 0, ..rules };
        (0..3).map(|color| Self::Band0(first + color * stored, rules)).collect()
    }
}

/// Channels whose nodes are rows behind an index. Nodes without a row hold what a row of zeros
/// makes.
#[derive(Debug)]
pub struct RowGrid {
    index: Arc<Index>,
    array: Arc<RowArray>,
    channels: Vec<Channel>,
    /// Nodes beyond each face of the index, which repeat the face's.
    border: usize,
    /// Arrays that the file's digest does not cover by their checksums.
    unchecked: Vec<Arc<RowArray>>,
    slabs: Slabs,
}

impl RowGrid {
    /// Of `array`, whose rows hold the columns of all `channels`. The field has `border` more nodes
    /// beyond each face, which repeat the face's. A digest samples the arrays `unchecked`: all that
    /// the field is made of, where the file's own digest holds no checksums of values.
    pub fn new(
        index: &Arc<Index>,
        array: &Arc<RowArray>,
        channels: Vec<Channel>,
        border: usize,
        unchecked: Vec<Arc<RowArray>>,
    ) -> Self {
        let slabs = Slabs::new(index, array);
        let (index, array) = (Arc::clone(index), Arc::clone(array));
        Self { index, array, channels, border, unchecked, slabs }
    }
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
        self.slabs.memory_bytes(&self.index, &self.array) + inflated
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        if !self.unchecked.is_empty() {
            self.index.digest(see)?;
        }
        self.unchecked.iter().try_for_each(|array| array.sample(see))
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let [nx, ny, nz] = self.index.nodes().0;
        let Nodes([_, _, outer_nz]) = self.nodes();
        let Some(&channel) = self.channels.get(channel) else { return Ok(0) };
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
        let inner = x.saturating_sub(self.border).min(nx - 1);
        let (element, size) = (self.array.element(), self.array.row_bytes());
        let at = channel.column() * element.size();
        // The places that repeat a node of the index along an axis.
        let places = |node: usize, count: usize| {
            let first = if node == 0 { 0 } else { node + self.border };
            let last = if node + 1 == count { node + 2 * self.border } else { node + self.border };
            first..last + 1
        };
        self.slabs.with_plane(&self.index, &self.array, inner, |plane| {
            for (&node, row) in plane.nodes.iter().zip(plane.rows.chunks_exact(size)) {
                let mut value = [0.0];
                element.decode(row.get(at..).unwrap_or_default(), &mut value);
                let value = channel.value(value[0]);
                let (y, z) = (node as usize / nz, node as usize % nz);
                for y in places(y, ny) {
                    for z in places(z, nz) {
                        if let Some(out) = out.get_mut(y * outer_nz + z) {
                            *out = value;
                        }
                    }
                }
            }
        })
    }
}
