//! Importance of each level's nodes to given cameras, or to viewers in the empty space nearby.
//!
//! That of one level is measured ([`crate::view::render::camera_coverage`],
//! [`crate::levels::importance`]). A camera that looks at level `k` is `2^k` times as far away, so
//! its picture of that level resembles one of level 0. A coarser node is therefore as important, in
//! the unit of its level, as the finer nodes around it are in theirs. Each coarser level takes the
//! importance of the level before it, averaged and resized like values, then normalized to its own
//! unit. Finer levels interpolate the measured importance.

use std::sync::Arc;

use super::BakeOptions;
use crate::levels::Kernel;
use crate::levels::importance::NodeImportance;
use crate::levels::taps::AxisTaps;
use crate::levels::visibility::{LinearTap, linear_tap};
use crate::model::grid::Nodes;
use crate::view::render::CameraCoverage;

/// Importance of one level's nodes.
#[derive(Debug)]
pub struct LevelImportance {
    /// Importance of squared colour errors, at the nodes of this level or of a coarser one.
    color: Arc<NodeImportance>,
}

impl LevelImportance {
    /// Importance of every level to cameras, finest first; none if nothing depends on it. The unit
    /// is the mean over a level's nodes with importance above 0.
    pub fn of_cameras(
        coverage: CameraCoverage,
        sizes: &[Nodes],
        options: &BakeOptions,
    ) -> Vec<Self> {
        if options.coarseness == 0.0 && options.fill_error.is_none() {
            return Vec::new();
        }
        let finest = NodeImportance { nodes: sizes[0], values: coverage.importance };
        Self::of_levels(finest, sizes, in_units_of_mean)
    }

    /// Importance of every level to viewers nearby, finest first, from the measured level.
    pub fn of_nearby(measured: NodeImportance, sizes: &[Nodes]) -> Vec<Self> {
        Self::of_levels(measured, sizes, NodeImportance::with_values)
    }

    fn of_levels(
        measured: NodeImportance,
        sizes: &[Nodes],
        with_values: impl Fn(Nodes, Vec<f32>) -> NodeImportance,
    ) -> Vec<Self> {
        let mut color = Arc::new(measured);
        let level = |&nodes: &Nodes| {
            if nodes.count() < color.nodes.count() {
                let values = coarser(&color.values, color.nodes, nodes);
                color = Arc::new(with_values(nodes, values));
            }
            Self { color: Arc::clone(&color) }
        };
        sizes.iter().map(level).collect()
    }

    /// Importance of the node at a place of the level, which has `nodes` nodes.
    pub fn node(&self, nodes: [usize; 3], at: [usize; 3]) -> f32 {
        let NodeImportance { nodes: Nodes(own), values } = &*self.color;
        let value = |[x, y, z]: [usize; 3]| values[(x * own[1] + y) * own[2] + z];
        if nodes == *own {
            return value(at);
        }
        let taps: [LinearTap; 3] =
            std::array::from_fn(|axis| linear_tap(at[axis], nodes[axis], own[axis]));
        let mut sum = 0.0;
        for corner in 0..8usize {
            let high = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = |axis: usize| match high[axis] {
                0 => 1.0 - taps[axis].fraction,
                _ => taps[axis].fraction,
            };
            let place = [0, 1, 2].map(|axis| [taps[axis].low, taps[axis].high][high[axis]]);
            sum += weight(0) * weight(1) * weight(2) * value(place);
        }
        sum
    }
}

/// In units of the mean of the values above 0.
fn in_units_of_mean(nodes: Nodes, mut values: Vec<f32>) -> NodeImportance {
    let some = values.iter().filter(|&&value| value > 0.0);
    let mean =
        some.clone().map(|&value| f64::from(value)).sum::<f64>() / some.count().max(1) as f64;
    if mean > 0.0 {
        values.iter_mut().for_each(|value| *value = (f64::from(*value) / mean) as f32);
    }
    NodeImportance { nodes, values }
}

/// The importance of the next coarser level's nodes, in units of the finer one's.
fn coarser(finer: &[f32], from: Nodes, to: Nodes) -> Vec<f32> {
    let mut values = finer.to_vec();
    let mut sizes = from.0;
    for axis in 0..3 {
        let taps = AxisTaps::new(sizes[axis], to.0[axis], &Kernel::Mean3.weights());
        let stride: usize = sizes[axis + 1..].iter().product();
        let planes = sizes[..axis].iter().product::<usize>();
        let mut out = vec![0.0; planes * to.0[axis] * stride];
        let (inputs, outputs) = (sizes[axis] * stride, to.0[axis] * stride);
        for (plane, out) in out.chunks_exact_mut(outputs).enumerate() {
            for (at, out) in out.chunks_exact_mut(stride).enumerate() {
                let (first, weights) = taps.window(at);
                for (tap, &weight) in weights.iter().enumerate() {
                    let row = &values[plane * inputs + (first + tap) * stride..][..stride];
                    out.iter_mut().zip(row).for_each(|(out, &value)| *out += weight as f32 * value);
                }
            }
        }
        values = out;
        sizes[axis] = to.0[axis];
    }
    values
}
