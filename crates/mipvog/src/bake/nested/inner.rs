//! The content of a box inside the next smaller one: the level that was made there.

use std::sync::Arc;

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::container::EncodedLevel;
use crate::model::baked::{BakedLevel, DensityDomain, GROUPS, Group, LevelMetadata, Metadata};
use crate::model::field::{Activation, Grid, Lattice, NodeValues, RadianceField};
use crate::model::grid::{Bounds, NodeMask, Nodes, row};
use crate::quantize::FrameShape;
use crate::unpacked::fill_plane;
use mipvog_format::sample::split;

/// Nodes at most this far beyond a face, relative to their spacing, lie on it.
const ON_FACE: f64 = 1e-3;

/// The decoded level of the next smaller box.
#[derive(Debug)]
pub struct InnerLevel {
    bounds: Bounds,
    metadata: LevelMetadata,
    level: BakedLevel,
    /// Density to optical depth of the smaller box.
    activation: Activation,
    /// The group of each channel, and the channel's number in it.
    channels: Vec<(Group, usize)>,
}

impl InnerLevel {
    /// For level 1 of a box that spans `bounds`.
    ///
    /// # Errors
    /// Errors of reading compressed runs.
    pub fn new(metadata: &Metadata, encoded: &[EncodedLevel], bounds: Bounds) -> Result<Self> {
        let layout = metadata.layout();
        let (own, coded) = (&metadata.levels[1], &encoded[1]);
        let mut atlases = [const { None }; GROUPS];
        let mut channels = Vec::new();
        for group in [Group::Density].into_iter().chain(Group::COLORS) {
            let (Some(encoding), Some(atlas)) =
                (own.encoding(group), &coded.atlases[group.index()])
            else {
                continue;
            };
            if group == Group::Directional {
                continue;
            }
            let count = group.channels(layout);
            let shape =
                FrameShape { number: encoding.number, channels: count, edge: own.block_size };
            atlases[group.index()] = Some(atlas.codes(shape, encoding, coded.table.frames())?);
            channels.extend((0..count).map(|channel| (group, channel)));
        }
        let level = BakedLevel { table: coded.table.clone(), atlases };
        let activation = metadata.activation;
        Ok(Self { bounds, metadata: own.clone(), level, activation, channels })
    }

    /// Bytes of its codes.
    pub fn bytes(&self) -> u64 {
        let codes = self.level.atlases.iter().flatten();
        codes.map(|codes| (codes.len() * codes.number_bytes()) as u64).sum()
    }

    fn nodes(&self) -> Nodes {
        Nodes(self.metadata.dimensions)
    }

    /// A stored density as raw density.
    fn raw(&self, stored: f32) -> f32 {
        if self.metadata.density_domain() != DensityDomain::Raw && stored == 0.0 {
            return self.activation.empty_raw();
        }
        let depth = match self.metadata.density_domain() {
            DensityDomain::Raw => return stored,
            DensityDomain::SqrtOpticalDepth => f64::from(stored) * f64::from(stored),
            DensityDomain::Opacity => -libm::log1p(-f64::from(stored).min(1.0 - 1e-7)),
        };
        self.activation.stored_raw(depth / f64::from(self.activation.interval))
    }

    /// One plane of a channel.
    fn plane(&self, channel: usize, x: usize) -> Vec<f32> {
        let [_, ny, nz] = self.nodes().0;
        let mut plane = vec![0.0; ny * nz];
        if let Some(&(group, channel)) = self.channels.get(channel) {
            fill_plane(&self.level, &self.metadata, group, channel, x, &mut plane);
        }
        plane
    }

    /// Values of a channel at places along the axes of its box, `0..=1`, on one plane. Places are
    /// passed over if `is_wanted` does not ask for them.
    fn read(
        &self,
        channel: usize,
        x: f64,
        [ys, zs]: [&[f64]; 2],
        is_wanted: impl Fn(usize, usize) -> bool,
        mut out: impl FnMut(usize, usize, f32),
    ) {
        let Nodes([nx, ny, nz]) = self.nodes();
        let (low, share) = split(x, nx);
        let planes = [self.plane(channel, low), self.plane(channel, low + 1)];
        let columns: Vec<_> = zs.iter().map(|&z| split(z, nz)).collect();
        for (j, &y) in ys.iter().enumerate() {
            let (row, up) = split(y, ny);
            for (k, &(column, across)) in columns.iter().enumerate() {
                if !is_wanted(j, k) {
                    continue;
                }
                let at = |plane: &[f32], y: usize| {
                    let pair = &plane[(row + y) * nz + column..][..2];
                    pair[0] + (pair[1] - pair[0]) * across
                };
                let on = |plane: &[f32]| at(plane, 0) + (at(plane, 1) - at(plane, 0)) * up;
                let value = on(&planes[0]) + (on(&planes[1]) - on(&planes[0])) * share;
                out(j, k, if channel == 0 { self.raw(value) } else { value });
            }
        }
    }
}

/// The nodes of a box that lie within a smaller one but not on its faces, along an axis.
fn within(lattice: &Lattice, smaller: &Bounds, axis: usize) -> std::ops::Range<usize> {
    let spacing = lattice.nodes.spacing(&lattice.bounds)[axis];
    let place = |at: f32| (f64::from(at) - f64::from(lattice.bounds.min[axis])) / spacing;
    let first = (place(smaller.min[axis]) + ON_FACE).floor() as usize + 1;
    let end = (place(smaller.max[axis]) - ON_FACE).ceil().max(0.0) as usize;
    first..end.clamp(first, lattice.nodes.0[axis])
}

/// Drops nodes whose surrounding cells all lie within a smaller box.
pub fn hollow(retained: &mut NodeMask, lattice: &Lattice, smaller: &Bounds) {
    // A cell that reaches over a face has a corner on the other side.
    let [xs, ys, zs] = [0, 1, 2].map(|axis| {
        let inside = within(lattice, smaller, axis);
        let low = usize::from(!aligned(lattice, smaller.min[axis], axis));
        let high = usize::from(!aligned(lattice, smaller.max[axis], axis));
        inside.start + low..inside.end.saturating_sub(high)
    });
    let words = retained.row_words();
    for x in xs {
        let plane = retained.plane_mut(x);
        for y in ys.clone() {
            let row = &mut plane[y * words..(y + 1) * words];
            zs.clone().for_each(|z| row[z / 64] &= !(1 << (z % 64)));
        }
    }
}

/// True if a face lies on nodes.
fn aligned(lattice: &Lattice, face: f32, axis: usize) -> bool {
    let spacing = lattice.nodes.spacing(&lattice.bounds)[axis];
    let place = (f64::from(face) - f64::from(lattice.bounds.min[axis])) / spacing;
    (place - libm::rint(place)).abs() <= ON_FACE
}

/// A shell as a field, with the values of a level inside the box that the level spans.
pub fn with_inner(shell: RadianceField, inner: &Arc<InnerLevel>) -> RadianceField {
    let lattice = shell.lattice();
    let mut first = 0;
    let mut filled = |grid: &Grid| {
        let own = WithInner { grid: grid.clone(), lattice, inner: Arc::clone(inner), first };
        first += grid.channels();
        Grid::Values(Arc::new(own))
    };
    let density = filled(&shell.density);
    let color = shell.color.iter().map(filled).collect();
    RadianceField { density, color, ..shell }
}

/// Channels of a shell, filled inside.
#[derive(Debug)]
struct WithInner {
    grid: Grid,
    lattice: Lattice,
    inner: Arc<InnerLevel>,
    /// The index of the grid's first channel in the field.
    first: usize,
}

impl NodeValues for WithInner {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        self.grid.channels()
    }

    fn memory_bytes(&self) -> u64 {
        self.grid.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        match &self.grid {
            Grid::Array(_) => Ok(()),
            Grid::Values(values) => values.digest(hash),
        }
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.grid.prepare(progress)
    }

    fn release(&self) {
        self.grid.release();
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let [xs, ys, zs] = [0, 1, 2].map(|axis| within(&self.lattice, &self.inner.bounds, axis));
        let Nodes([_, ny, nz]) = self.lattice.nodes;
        if !xs.contains(&x) || ys.is_empty() || zs.is_empty() {
            return self.grid.read_region(channel, x, region, out);
        }
        let words = region.len() / ny;
        let mut outside = region.to_vec();
        for y in ys.clone() {
            let row = &mut outside[y * words..(y + 1) * words];
            zs.clone().for_each(|z| row[z / 64] &= !(1 << (z % 64)));
        }
        let read = self.grid.read_region(channel, x, &outside, out)?;
        let place = |axis: usize, node: usize| {
            let at = self.lattice.position(std::array::from_fn(|_| node))[axis];
            let bounds = &self.inner.bounds;
            ((at - f64::from(bounds.min[axis])) / bounds.extent()[axis]).clamp(0.0, 1.0)
        };
        let rows: Vec<usize> = ys
            .filter(|&y| row::any_between(&region[y * words..(y + 1) * words], zs.start, zs.end))
            .collect();
        if rows.is_empty() {
            return Ok(read);
        }
        let at_rows: Vec<f64> = rows.iter().map(|&y| place(1, y)).collect();
        let at_columns: Vec<f64> = zs.clone().map(|z| place(2, z)).collect();
        self.inner.read(
            self.first + channel,
            place(0, x),
            [&at_rows, &at_columns],
            |j, k| {
                let z = zs.start + k;
                region[rows[j] * words + z / 64] >> (z % 64) & 1 == 1
            },
            |j, k, value| {
                if let Some(out) = out.get_mut(rows[j] * nz + zs.start + k) {
                    *out = value;
                }
            },
        );
        Ok(read)
    }
}
