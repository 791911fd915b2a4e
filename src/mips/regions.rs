//! Which nodes of each level must come out right: what somebody needs, and what coarser levels read of it.

use super::Kernel;
use super::taps::AxisTaps;
use crate::error::Result;
use crate::grid::{NodeMask, row};
use crate::parallel;

/// The nodes of each level that must come out right.
#[derive(Debug)]
pub struct Regions {
    pub(super) steps: Vec<Step>,
    /// By level; what a level's own users need and what the next level reads.
    pub(super) levels: Vec<NodeMask>,
}

/// Weights from one level to the next.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) axes: [AxisTaps; 3],
}

impl Step {
    /// Adds the nodes of plane `x` of the finer level that output nodes in `outputs` read to its rows of bits.
    fn read_rows(&self, x: usize, outputs: &NodeMask, rows: &mut [u64]) {
        let wanted = self.wanted_rows(x, outputs);
        let words = outputs.row_words();
        let [_, y_taps, z_taps] = &self.axes;
        let fine_words = z_taps.inputs().div_ceil(64);
        let mut merged = vec![0; words];
        for (y, row) in rows.chunks_exact_mut(fine_words).enumerate() {
            merged.fill(0);
            let (start, end) = y_taps.readers(y);
            for wanted in wanted[start * words..end * words].chunks_exact(words) {
                row::or_into(&mut merged, wanted);
            }
            z_taps.spread(&merged, row);
        }
    }

    /// Nodes that output planes reading plane `x` need: rows of bits at the coarser level's size.
    pub(super) fn wanted_rows(&self, x: usize, outputs: &NodeMask) -> Vec<u64> {
        let mut wanted = vec![0; outputs.plane(0).len()];
        let (start, end) = self.axes[0].readers(x);
        for output in start..end {
            row::or_into(&mut wanted, outputs.plane(output));
        }
        wanted
    }
}

impl Regions {
    /// Grows what is `needed` of each level, finest first, by what coarser levels read of it.
    pub fn new(needed: Vec<NodeMask>, kernel: Kernel) -> Result<Self> {
        let weights = kernel.weights();
        let steps: Vec<Step> = needed
            .windows(2)
            .map(|pair| {
                let (fine, coarse) = (pair[0].nodes().0, pair[1].nodes().0);
                let axes = [0, 1, 2].map(|axis| AxisTaps::new(fine[axis], coarse[axis], &weights));
                Step { axes }
            })
            .collect();
        let mut levels = needed;
        for (level, step) in steps.iter().enumerate().rev() {
            let (finer, coarser) = levels.split_at_mut(level + 1);
            let coarse = &coarser[0];
            parallel::map_mut(&mut finer[level].planes_mut(0), |x, rows| {
                step.read_rows(x, coarse, rows);
                Ok(())
            })?;
        }
        Ok(Self { steps, levels })
    }

    /// Nodes of a level that must be right for its own users or for coarser levels.
    pub fn level(&self, level: usize) -> &NodeMask {
        &self.levels[level]
    }
}
