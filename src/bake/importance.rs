//! Importance of each level's nodes to given cameras.
//!
//! Level 0's is measured ([`crate::view::render::camera_coverage`]). A camera that looks at level
//! `k` is `2^k` times as far away, and its picture of that level is like one of level 0. So a
//! coarser node is as important, against the mean of its level, as the finer nodes around it are
//! against the mean of theirs. Each level's importance is therefore the one before it, averaged and
//! resized as levels are, in units of its own mean again.

use super::{BakeOptions, Importance};
use crate::levels::Kernel;
use crate::levels::taps::AxisTaps;
use crate::model::grid::Nodes;
use crate::view::render::CameraCoverage;

/// Of one level's nodes, z fastest.
#[derive(Debug)]
pub struct LevelImportance {
    /// Of squared errors of colours, in units of their mean over the nodes that have any.
    color: Vec<f32>,
}

impl LevelImportance {
    /// Of every level, finest first; none where nothing depends on it.
    pub fn of_levels(
        coverage: CameraCoverage,
        sizes: &[Nodes],
        options: &BakeOptions,
    ) -> Vec<Self> {
        if options.coarseness == 0.0 && options.fill_error.is_none() {
            return Vec::new();
        }
        let mut levels = vec![Self { color: coverage.importance }];
        for pair in sizes.windows(2) {
            let color = levels.last().map(|finer| coarser(&finer.color, pair[0], pair[1]));
            levels.extend(color.map(|color| Self { color }));
        }
        levels
    }

    /// That of the node at a place of a level with so many nodes.
    pub fn node(&self, sizes: [usize; 3], [x, y, z]: [usize; 3]) -> f32 {
        self.color[(x * sizes[1] + y) * sizes[2] + z]
    }

    /// As encoders take it.
    pub fn importance(&self, coarseness: f32) -> Importance<'_> {
        Importance { by_node: &self.color, coarseness }
    }
}

/// The importance of the next coarser level's nodes, in units of the mean of the values above 0.
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
    let some = values.iter().filter(|&&value| value > 0.0);
    let mean =
        some.clone().map(|&value| f64::from(value)).sum::<f64>() / some.count().max(1) as f64;
    if mean > 0.0 {
        values.iter_mut().for_each(|value| *value = (f64::from(*value) / mean) as f32);
    }
    values
}
