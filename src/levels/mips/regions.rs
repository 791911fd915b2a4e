//! Which nodes of each level must come out right: what somebody needs, and what coarser levels read of it.
//!
//! Where matter is averaged, most nodes hold none: what they add is 0, whatever they are. So coarser levels
//! read only what holds matter, and cost follows the scene and not the box around it.

use super::Kernel;
use super::taps::AxisTaps;
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::grid::{NodeMask, Nodes, row};

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

    /// The output nodes that read a node in `inputs`, as a set of `outputs` nodes.
    fn reached(&self, inputs: &NodeMask, outputs: Nodes) -> Result<NodeMask> {
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
                z_taps.gather(&merged, out);
            }
            Ok(())
        })
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
    /// Grows what is `needed` of each level, finest first, by what coarser levels read of it: of nodes that are not in
    /// `matter`, a set of level 0, they read 0.
    pub fn new(needed: Vec<NodeMask>, matter: Option<&NodeMask>, kernel: Kernel) -> Result<Self> {
        let sizes: Vec<Nodes> = needed.iter().map(NodeMask::nodes).collect();
        let steps = steps(&sizes, kernel);
        let spread = matter.map(|matter| spread(matter, &sizes, &steps)).transpose()?;
        // Of each level what is not 0.
        let holding = |level: usize| match level {
            0 => matter,
            _ => spread.as_ref().map(|spread| &spread[level - 1]),
        };
        let mut levels = needed;
        for (level, step) in steps.iter().enumerate().rev() {
            let (finer, coarser) = levels.split_at_mut(level + 1);
            let (coarse, holding) = (&coarser[0], holding(level));
            parallel::map_mut(&mut finer[level].planes_mut(0), |x, rows| {
                let mut read = vec![0; rows.len()];
                step.read_rows(x, coarse, &mut read);
                if let Some(holding) = holding {
                    row::and_into(&mut read, holding.plane(x));
                }
                row::or_into(rows, &read);
                Ok(())
            })?;
        }
        Ok(Self { steps, levels })
    }

    /// The nodes of levels of `sizes` that `matter`, a set of level 0, spreads to.
    pub fn of_matter(matter: NodeMask, sizes: &[Nodes], kernel: Kernel) -> Result<Self> {
        let steps = steps(sizes, kernel);
        let spread = spread(&matter, sizes, &steps)?;
        let levels = std::iter::once(matter).chain(spread).collect();
        Ok(Self { steps, levels })
    }

    /// Nodes of a level that must be right for its own users or for coarser levels.
    pub fn level(&self, level: usize) -> &NodeMask {
        &self.levels[level]
    }

    /// Those of level 0, by themselves.
    pub fn into_finest(self) -> Option<NodeMask> {
        self.levels.into_iter().next()
    }
}

/// Weights between levels of `sizes`.
fn steps(sizes: &[Nodes], kernel: Kernel) -> Vec<Step> {
    let weights = kernel.weights();
    let step = |pair: &[Nodes]| {
        let (fine, coarse) = (pair[0].0, pair[1].0);
        Step { axes: [0, 1, 2].map(|axis| AxisTaps::new(fine[axis], coarse[axis], &weights)) }
    };
    sizes.windows(2).map(step).collect()
}

/// The nodes of levels from 1 on that `matter`, a set of level 0, spreads to.
fn spread(matter: &NodeMask, sizes: &[Nodes], steps: &[Step]) -> Result<Vec<NodeMask>> {
    let mut levels: Vec<NodeMask> = Vec::with_capacity(steps.len());
    for (step, &outputs) in steps.iter().zip(&sizes[1..]) {
        levels.push(step.reached(levels.last().unwrap_or(matter), outputs)?);
    }
    Ok(levels)
}
