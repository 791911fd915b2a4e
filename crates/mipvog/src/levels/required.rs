//! The nodes of each level whose values must be exact: the retained ones, and those that coarser
//! levels read.
//!
//! If alpha is averaged, most nodes have alpha 0 and add nothing. Coarser levels then read only
//! nodes that are not empty, so cost depends on the scene and not on the box around it.

use super::taps::AxisTaps;
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::grid::{NodeMask, Nodes, row};

/// The nodes of each level whose values must be exact, and the weights between levels.
#[derive(Debug)]
pub struct RequiredNodes {
    pub(super) steps: Vec<LevelTaps>,
    /// By level, finest first.
    pub(super) levels: Vec<NodeMask>,
}

/// Weights from one level to the next.
#[derive(Debug, Clone)]
pub(super) struct LevelTaps {
    pub(super) axes: [AxisTaps; 3],
}

impl LevelTaps {
    /// Adds the nodes of plane `x` of the finer level that output nodes in `outputs` read to its
    /// rows of bits.
    fn add_inputs(&self, x: usize, outputs: &NodeMask, rows: &mut [u64]) {
        let readers = self.reader_rows(x, outputs);
        let words = outputs.row_words();
        let [_, y_taps, z_taps] = &self.axes;
        let fine_words = z_taps.inputs().div_ceil(64);
        let mut merged = vec![0; words];
        for (y, row) in rows.chunks_exact_mut(fine_words).enumerate() {
            merged.fill(0);
            let (start, end) = y_taps.readers(y);
            for readers in readers[start * words..end * words].chunks_exact(words) {
                row::or_into(&mut merged, readers);
            }
            z_taps.add_inputs(&merged, row);
        }
    }

    /// The output nodes that read a node in `inputs`, as a set of `outputs` nodes.
    fn outputs_of(&self, inputs: &NodeMask, outputs: Nodes) -> Result<NodeMask> {
        let [x_taps, y_taps, z_taps] = &self.axes;
        let words = inputs.row_words();
        let coarse_words = row::words(outputs);
        NodeMask::of_planes(outputs, |x, rows| {
            let mut plane = vec![0; inputs.plane(0).len()];
            let (first, weights) = x_taps.window(x);
            for input in first..first + weights.len() {
                row::or_into(&mut plane, inputs.plane(input));
            }
            let mut merged = vec![0; words];
            for (y, out) in rows.chunks_exact_mut(coarse_words).enumerate() {
                merged.fill(0);
                let (first, weights) = y_taps.window(y);
                for row in plane[first * words..][..weights.len() * words].chunks_exact(words) {
                    row::or_into(&mut merged, row);
                }
                z_taps.add_outputs(&merged, out);
            }
            Ok(())
        })
    }

    /// Output nodes in `outputs` of all planes that read plane `x`: rows of bits at the coarser
    /// level's size.
    pub(super) fn reader_rows(&self, x: usize, outputs: &NodeMask) -> Vec<u64> {
        let mut rows = vec![0; outputs.plane(0).len()];
        let (start, end) = self.axes[0].readers(x);
        for output in start..end {
            row::or_into(&mut rows, outputs.plane(output));
        }
        rows
    }
}

impl RequiredNodes {
    /// Grows the `retained` nodes of each level, finest first, by those that coarser levels read
    /// through a low-pass with these `weights`. Nodes outside `occupied`, a set of level 0, have
    /// alpha 0 and are not read.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn new(
        retained: Vec<NodeMask>,
        occupied: Option<&NodeMask>,
        weights: &[f64],
    ) -> Result<Self> {
        let sizes: Vec<Nodes> = retained.iter().map(NodeMask::nodes).collect();
        let steps = steps(&sizes, weights);
        let coarser = occupied.map(|occupied| occupied_levels(occupied, &sizes, &steps));
        let coarser = coarser.transpose()?;
        let occupied_of = |level: usize| match level {
            0 => occupied,
            _ => coarser.as_ref().map(|coarser| &coarser[level - 1]),
        };
        let mut levels = retained;
        for (level, step) in steps.iter().enumerate().rev() {
            let (finer, coarser) = levels.split_at_mut(level + 1);
            let (outputs, occupied) = (&coarser[0], occupied_of(level));
            parallel::map_mut(&mut finer[level].planes_mut(0), |x, rows| {
                let mut inputs = vec![0; rows.len()];
                step.add_inputs(x, outputs, &mut inputs);
                if let Some(occupied) = occupied {
                    row::and_into(&mut inputs, occupied.plane(x));
                }
                row::or_into(rows, &inputs);
                Ok(())
            })?;
        }
        Ok(Self { steps, levels })
    }

    /// The nodes of levels of `sizes` whose alpha is not 0, for a level 0 of which only `occupied`
    /// nodes are not empty.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn of_occupied(occupied: NodeMask, sizes: &[Nodes], weights: &[f64]) -> Result<Self> {
        let steps = steps(sizes, weights);
        let coarser = occupied_levels(&occupied, sizes, &steps)?;
        let levels = std::iter::once(occupied).chain(coarser).collect();
        Ok(Self { steps, levels })
    }

    /// All levels, finest first.
    pub fn levels(&self) -> &[NodeMask] {
        &self.levels
    }

    /// The required nodes of a level.
    pub fn level(&self, level: usize) -> &NodeMask {
        &self.levels[level]
    }

    /// The nodes of level 0 alone.
    pub fn into_finest(self) -> Option<NodeMask> {
        self.levels.into_iter().next()
    }
}

/// Weights between levels of `sizes`.
fn steps(sizes: &[Nodes], weights: &[f64]) -> Vec<LevelTaps> {
    let step = |pair: &[Nodes]| {
        let (fine, coarse) = (pair[0].0, pair[1].0);
        LevelTaps { axes: [0, 1, 2].map(|axis| AxisTaps::new(fine[axis], coarse[axis], weights)) }
    };
    sizes.windows(2).map(step).collect()
}

/// The nodes of levels from 1 on that read a node of `occupied`, a set of level 0.
fn occupied_levels(
    occupied: &NodeMask,
    sizes: &[Nodes],
    steps: &[LevelTaps],
) -> Result<Vec<NodeMask>> {
    let mut levels: Vec<NodeMask> = Vec::with_capacity(steps.len());
    for (step, &outputs) in steps.iter().zip(&sizes[1..]) {
        levels.push(step.outputs_of(levels.last().unwrap_or(occupied), outputs)?);
    }
    Ok(levels)
}
