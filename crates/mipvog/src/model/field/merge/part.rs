//! A field on the grid of another one.

use std::ops::Range;

use super::{COINCIDENT, depth_of_density};
use crate::base::error::Result;
use crate::model::field::{Lattice, RadianceField, Scene};
use crate::model::grid::{Bounds, NodeMask, row};

/// Samples this many voxels around a node determine whether its field continues there.
const REACH: f64 = 0.5;

/// Densities mean the same if optical depths differ by at most this share.
const SAME_DEPTH: f64 = 1e-6;

/// A field, and the nodes of a grid that lie in its box.
#[derive(Debug)]
pub struct Part {
    field: RadianceField,
    /// The nodes of the grid in the field's box, along each axis.
    pub spans: [Range<usize>; 3],
    /// For each of them, the field's node at or below it, and the weight of the next one.
    places: [Vec<(usize, f64)>; 3],
    /// For each of them, whether it lies off the faces of the field's box.
    within: [Vec<bool>; 3],
    /// The nodes that a crop or a free-space mask leaves.
    left: Option<Left>,
    /// Optical depth per world unit of a density of 1.
    depth_of_density: f64,
    /// True if raw densities mean the same as the first field's.
    pub is_alike: bool,
}

/// Nodes of the grid that a field's crop and free-space mask leave.
#[derive(Debug)]
struct Left {
    /// Nodes with any counting sample nearby.
    some: NodeMask,
    /// Nodes with only counting samples around.
    all: NodeMask,
}

impl Part {
    /// A field on `lattice`, whose densities have the meaning of `first`.
    pub fn new(field: &RadianceField, lattice: &Lattice, first: &Scene) -> Result<Self> {
        let own = field.lattice();
        let mut spans = [0..0, 0..0, 0..0];
        let mut places = [Vec::new(), Vec::new(), Vec::new()];
        let mut within = [Vec::new(), Vec::new(), Vec::new()];
        for axis in 0..3 {
            let last = own.nodes.0[axis] - 1;
            let voxel = own.bounds.extent()[axis] / last as f64;
            let step = lattice.bounds.extent()[axis] / (lattice.nodes.0[axis] - 1) as f64;
            let offset = f64::from(lattice.bounds.min[axis]) - f64::from(own.bounds.min[axis]);
            let places_of = (0..lattice.nodes.0[axis])
                .map(|node| (node, place((offset + node as f64 * step) / voxel, last)));
            let inside: Vec<_> =
                places_of.filter_map(|(node, place)| Some((node, place?))).collect();
            let start = inside.first().map_or(0, |&(node, _)| node);
            spans[axis] = start..start + inside.len();
            places[axis] = inside.into_iter().map(|(_, place)| place).collect();
            let is_within = |&(node, share): &(usize, f64)| {
                (REACH..=last as f64 - REACH).contains(&(node as f64 + share))
            };
            within[axis] = places[axis].iter().map(is_within).collect();
        }
        let depth_of_density = depth_of_density(&field.scene);
        let [own, of_first] = [&field.scene, first].map(|scene| scene.activation);
        let ratio = depth_of_density / super::depth_of_density(first);
        let is_alike = own.function == of_first.function
            && own.shift == of_first.shift
            && (ratio - 1.0).abs() <= SAME_DEPTH;
        let left = left(field, lattice, &spans)?;
        Ok(Self { field: field.clone(), spans, places, within, left, depth_of_density, is_alike })
    }

    /// The field.
    pub fn field(&self) -> &RadianceField {
        &self.field
    }

    /// True if another field has nodes in the same place.
    pub fn meets(&self, other: &Self) -> bool {
        let mut spans = self.spans.iter().zip(&other.spans);
        spans.all(|(a, b)| a.start.max(b.start) < a.end.min(b.end))
    }

    /// True if the field continues around a node in its box: no face, crop or mask cuts there.
    pub fn goes_on(&self, node: [usize; 3]) -> bool {
        let is_within = |axis: usize| self.within[axis][node[axis] - self.spans[axis].start];
        let all = self.left.as_ref().is_none_or(|left| left.all.contains(node));
        all && (0..3).all(is_within)
    }

    /// Optical depth per world unit of a raw density.
    pub fn depth(&self, raw: f32) -> f64 {
        self.field.scene.activation.density(raw.into()) * self.depth_of_density
    }

    /// Raw densities at the nodes in the box of plane `x` of the grid; nodes that do not count are
    /// empty. None outside the box.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn densities(&self, x: usize) -> Result<Option<Vec<f32>>> {
        let Some(mut values) = self.channel(0, x)? else { return Ok(None) };
        if let Some(left) = &self.left {
            let empty = self.field.scene.activation.empty_raw();
            let [_, ys, zs] = &self.spans;
            for (y, values) in ys.clone().zip(values.chunks_exact_mut(zs.len())) {
                let row = left.some.row(x, y);
                let outside = zs.clone().zip(values).filter(|&(z, _)| !row::get(row, z));
                outside.for_each(|(_, value)| *value = empty);
            }
        }
        Ok(Some(values))
    }

    /// A channel of colour likewise; 0 for one that the field lacks.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn colors(&self, channel: usize, x: usize) -> Result<Option<Vec<f32>>> {
        self.channel(1 + channel, x)
    }

    /// A channel (0 is density) at the nodes in the box of plane `x` of the grid.
    fn channel(&self, channel: usize, x: usize) -> Result<Option<Vec<f32>>> {
        let [xs, ys, zs] = &self.spans;
        if !xs.contains(&x) || ys.is_empty() || zs.is_empty() {
            return Ok(None);
        }
        let mut values = vec![0.0; ys.len() * zs.len()];
        let Some((grid, channel)) = self.field.grid_of(channel) else { return Ok(Some(values)) };
        let [_, rows, length] = grid.nodes().0;
        let (low, share) = self.places[0][x - xs.start];
        let mut sums = vec![0.0f64; values.len()];
        let mut plane = vec![0.0f32; rows * length];
        for (node, weight) in ends((low, share)) {
            grid.read_plane(channel, node, &mut plane, |_| {})?;
            for (&y, sums) in self.places[1].iter().zip(sums.chunks_exact_mut(zs.len())) {
                for (y, of_row) in ends(y) {
                    let (row, weight) = (&plane[y * length..][..length], weight * of_row);
                    for (&z, sum) in self.places[2].iter().zip(&mut *sums) {
                        for (z, of_node) in ends(z) {
                            *sum += weight * of_node * f64::from(row[z]);
                        }
                    }
                }
            }
        }
        values.iter_mut().zip(sums).for_each(|(value, sum)| *value = sum as f32);
        Ok(Some(values))
    }
}

/// The nodes that a place lies between, with their weights.
fn ends((low, share): (usize, f64)) -> impl Iterator<Item = (usize, f64)> {
    [(low, 1.0 - share), (low + 1, share)].into_iter().filter(|&(_, weight)| weight != 0.0)
}

/// The node at or below a place in voxels, and the share of the next one; none outside the box of
/// `last` voxels.
fn place(at: f64, last: usize) -> Option<(usize, f64)> {
    let nearest = at.round();
    let at = if (at - nearest).abs() <= COINCIDENT { nearest } else { at };
    if !(0.0..=last as f64).contains(&at) {
        return None;
    }
    let low = (at as usize).min(last);
    Some((low, at - low as f64))
}

/// The grid's nodes that the field's crop and free-space mask leave; none if it has neither.
fn left(
    field: &RadianceField,
    lattice: &Lattice,
    spans: &[Range<usize>; 3],
) -> Result<Option<Left>> {
    let (mask, sampled) = (field.free_space.as_ref(), field.scene.march.sampled);
    if mask.is_none() && sampled.is_none() {
        return Ok(None);
    }
    let own = field.lattice();
    let reach = own.nodes.spacing(&own.bounds).map(|voxel| REACH * voxel);
    let counts = |at: [f64; 3]| {
        let within = |bounds: &Bounds| {
            let inside = |axis: usize| {
                let [low, high] = [bounds.min[axis], bounds.max[axis]].map(f64::from);
                (low..=high).contains(&at[axis])
            };
            (0..3).all(inside)
        };
        mask.is_none_or(|mask| mask.contains(at)) && sampled.as_ref().is_none_or(within)
    };
    // Samples at a node and around it.
    let samples = |node: [usize; 3]| {
        let middle = lattice.position(node);
        (0..27).map(move |number| {
            let way = [number / 9, number / 3 % 3, number % 3].map(|way| f64::from(way) - 1.0);
            [0, 1, 2].map(|axis| middle[axis] + way[axis] * reach[axis])
        })
    };
    let nodes_where = |keep: &(dyn Fn([usize; 3]) -> bool + Sync)| {
        NodeMask::of_planes(lattice.nodes, |x, plane| {
            let rows = plane.chunks_exact_mut(row::words(lattice.nodes)).enumerate();
            for (y, row) in rows.filter(|(y, _)| spans[0].contains(&x) && spans[1].contains(y)) {
                spans[2].clone().filter(|&z| keep([x, y, z])).for_each(|z| row::set(row, z));
            }
            Ok(())
        })
    };
    Ok(Some(Left {
        some: nodes_where(&|node| samples(node).any(counts))?,
        all: nodes_where(&|node| samples(node).all(counts))?,
    }))
}
