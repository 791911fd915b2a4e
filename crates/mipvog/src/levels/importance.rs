//! Importance of nodes to viewers in the empty space around them.
//!
//! Without cameras, viewers are assumed to be in empty space. So a node counts by how much light of
//! empty space it can reflect. Light comes from all sides through the nodes on its way
//! ([`super::transmittance`]), and it recovers in empty nodes: a closed room has light of its own.
//! Colours are interpolated, so a node also counts for the cells around it:
//!
//! ```text
//! importance(node) = tent over the node and its neighbours p of alpha(p) * light(p)
//! alpha(p)         = 1 - exp(-depth(p))
//! ```
//!
//! with `depth` the optical depth of one interval, `light` the mean over 26 directions, and `tent`
//! the weights 1/4, 1/2 and 1/4 along each axis. The unit of importance is the mean over all nodes,
//! weighted by importance, so that unimportant nodes do not change it.

use multiversion::multiversion;

use super::transmittance::{PlaneLight, TransmittanceSweep};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::grid::Nodes;

/// The share of lost light that recovers behind an empty node: two thirds after four nodes.
pub const RECOVERY: f32 = 0.25;

/// The importance of the nodes of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeImportance {
    /// The grid's size.
    pub nodes: Nodes,
    /// Importance of each node, z fastest; 0 for empty nodes.
    pub values: Vec<f32>,
}

impl NodeImportance {
    /// Importance to viewers in the empty space of the grid of a sweep, and around it.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn nearby(sweep: TransmittanceSweep) -> Result<Self> {
        let mut light = TransmittanceSweep { recovery: RECOVERY, ..sweep }.run(false)?;
        parallel::map_mut(&mut light, |x, PlaneLight { sums, .. }| {
            reflect(&sweep.depths[x], sums);
            Ok(())
        })?;
        let mut values = Vec::with_capacity(sweep.nodes.count());
        light.into_iter().for_each(|plane| values.extend(plane.sums));
        let mut importance = Self { nodes: sweep.nodes, values };
        importance.spread()?;
        importance.set_unit();
        Ok(importance)
    }

    /// Adds a share of each node to its neighbours.
    fn spread(&mut self) -> Result<()> {
        let Nodes([_, ny, nz]) = self.nodes;
        let mut planes: Vec<&mut [f32]> = self.values.chunks_mut(ny * nz).collect();
        parallel::map_mut(&mut planes, |_, plane| {
            let mut last = vec![0.0; nz];
            plane.chunks_mut(nz).for_each(|row| tent(row, 1, &mut [0.0]));
            tent(plane, nz, &mut last);
            Ok(())
        })?;
        drop(planes);
        tent(&mut self.values, ny * nz, &mut vec![0.0; ny * nz]);
        Ok(())
    }

    /// Divides by the unit.
    fn set_unit(&mut self) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for &value in &self.values {
            let value = f64::from(value);
            sum += value;
            squares += value * value;
        }
        if squares > 0.0 {
            let per_unit = sum / squares;
            self.values.iter_mut().for_each(|value| *value = (f64::from(*value) * per_unit) as f32);
        }
    }

    /// Importance of coarser levels is derived from this one, in their own units.
    #[must_use]
    pub fn with_values(nodes: Nodes, values: Vec<f32>) -> Self {
        let mut coarser = Self { nodes, values };
        coarser.set_unit();
        coarser
    }
}

/// Converts sums of 26 transmittances to the light that nodes of these depths reflect.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn reflect(depths: &[f32], sums: &mut [f32]) {
    for (sum, depth) in sums.iter_mut().zip(depths) {
        *sum *= (1.0 / 26.0) * lanes::opacity(*depth);
    }
}

/// The tent along lines whose neighbours are `stride` apart, with zeros beyond their ends. `last`
/// is a buffer of `stride` zeros.
fn tent(values: &mut [f32], stride: usize, last: &mut [f32]) {
    for start in (0..values.len()).step_by(stride) {
        let (row, rest) = values[start..].split_at_mut(stride);
        let next = rest.get(..stride).unwrap_or(&[]);
        for (i, (value, last)) in row.iter_mut().zip(&mut *last).enumerate() {
            let own = *value;
            *value = 0.5 * own + 0.25 * (*last + next.get(i).copied().unwrap_or(0.0));
            *last = own;
        }
    }
}
