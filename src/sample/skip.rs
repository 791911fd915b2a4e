//! Where rays need not look.
//!
//! The box is cut into *macro cells*, each spanning a block's worth of level-0 cells. For each level
//! a set of macro cells says where samples of that level and of the next coarser one (rays blend the
//! two) can be seen. A ray jumps over the others.

use crate::error::Result;
use crate::field::{FreeSpace, Lookup};
use crate::grid::{Bounds, NodeMask, Nodes};
use crate::prune;

/// What a macro cell says about samples in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Macro {
    /// Nothing can be seen.
    Empty,
    /// Samples count.
    Open,
    /// Samples count where the free-space mask says so.
    Masked,
}

/// Macro cells of a field.
#[derive(Debug, Clone)]
pub struct SkipGrid {
    counts: [usize; 3],
    /// Macro cells along the whole box, which the last ones may overhang.
    scale: [f64; 3],
    levels: Vec<Vec<Macro>>,
}

impl SkipGrid {
    /// For level 0 of `nodes` nodes in macro cells of `edge` of its cells. `seen(level)` marks the
    /// macro cells in which samples of that level alone may be seen, z fastest.
    pub fn new(
        nodes: Nodes,
        edge: usize,
        bounds: &Bounds,
        free_space: Option<&FreeSpace>,
        seen: Vec<Vec<bool>>,
    ) -> Result<Self> {
        let counts = nodes.0.map(|size| (size - 1).div_ceil(edge));
        let scale = nodes.0.map(|size| (size - 1) as f64 / edge as f64);
        let masks = match free_space {
            Some(free_space) => Some(mask_states(free_space, bounds, nodes, edge)?),
            None => None,
        };
        let state = |seen: bool, masked: Option<Macro>| match (seen, masked) {
            (false, _) | (_, Some(Macro::Empty)) => Macro::Empty,
            (true, masked) => masked.unwrap_or(Macro::Open),
        };
        let mut levels = Vec::with_capacity(seen.len());
        for (level, own) in seen.iter().enumerate() {
            let coarser = seen.get(level + 1).unwrap_or(own);
            let cells = own.iter().zip(coarser).enumerate().map(|(i, (&own, &coarser))| {
                state(own || coarser, masks.as_ref().map(|masks| masks[i]))
            });
            levels.push(cells.collect());
        }
        Ok(Self { counts, scale, levels })
    }

    /// Macro cells along each axis of a level of `nodes` in macro cells of `edge` level-0 cells.
    pub fn counts(nodes: Nodes, edge: usize) -> [usize; 3] {
        nodes.0.map(|size| (size - 1).div_ceil(edge))
    }

    /// The macro cell of a position, `0..=1` along each axis.
    pub fn place(&self, position: [f64; 3]) -> [usize; 3] {
        std::array::from_fn(|axis| {
            ((position[axis] * self.scale[axis]) as usize).min(self.counts[axis] - 1)
        })
    }

    /// What is in a macro cell for samples that blend `level` and the next.
    pub fn state(&self, level: usize, [x, y, z]: [usize; 3]) -> Macro {
        self.levels[level][(x * self.counts[1] + y) * self.counts[2] + z]
    }

    /// Where a ray leaves a macro cell: the least `k` at which `start + k * step` lies on a face that
    /// it moves towards, in positions `0..=1`. Infinity where it does not move.
    pub fn leaves(&self, place: [usize; 3], start: [f64; 3], step: [f64; 3]) -> f64 {
        let mut least = f64::INFINITY;
        for axis in 0..3 {
            if step[axis] == 0.0 {
                continue;
            }
            let face = place[axis] + usize::from(step[axis] > 0.0);
            let at = face as f64 / self.scale[axis];
            least = least.min((at - start[axis]) / step[axis]);
        }
        least
    }
}

/// Marks the macro cells that a level's marked blocks overlap. `blocks` are marked by their numbers,
/// of `edge` nodes each; a block holds the cells whose lowest nodes it holds.
pub fn mark_blocks(
    blocks: &[bool],
    nodes: Nodes,
    edge: usize,
    finest: Nodes,
    macro_edge: usize,
) -> Vec<bool> {
    let counts = SkipGrid::counts(finest, macro_edge);
    let block_counts = nodes.0.map(|size| size.div_ceil(edge));
    // First and one past the last macro cell that block i of an axis overlaps.
    let range = |axis: usize, i: usize| {
        let to_macro = (finest.0[axis] - 1) as f64 / (macro_edge * (nodes.0[axis] - 1)) as f64;
        let low = (i * edge) as f64 * to_macro;
        let high = ((i + 1) * edge).min(nodes.0[axis] - 1) as f64 * to_macro;
        // Rounding must not lose a macro cell at whose face a block ends.
        let start = (low - 1e-9).max(0.0) as usize;
        (start.min(counts[axis] - 1), ((high + 1e-9).ceil() as usize).min(counts[axis]))
    };
    let mut marked = vec![false; counts.iter().product()];
    for (block, _) in blocks.iter().enumerate().filter(|(_, marked)| **marked) {
        let [_, by, bz] = block_counts;
        let place = [block / bz / by, block / bz % by, block % bz];
        let [xs, ys, zs] = [0, 1, 2].map(|axis| range(axis, place[axis]));
        for x in xs.0..xs.1 {
            for y in ys.0..ys.1 {
                marked[(x * counts[1] + y) * counts[2]..][zs.0..zs.1].fill(true);
            }
        }
    }
    marked
}

fn mask_states(
    free_space: &FreeSpace,
    bounds: &Bounds,
    nodes: Nodes,
    edge: usize,
) -> Result<Vec<Macro>> {
    let counts = SkipGrid::counts(nodes, edge);
    let faces: [Vec<f64>; 3] = [0, 1, 2].map(|axis| {
        let (min, spacing) = (f64::from(bounds.min[axis]), nodes.spacing(bounds)[axis]);
        let node = |i: usize| (i * edge).min(nodes.0[axis] - 1) as f64;
        (0..=counts[axis]).map(|i| min + node(i) * spacing).collect()
    });
    let touched = prune::touched_cells(free_space, &faces)?;
    let outside = prune::touched_cells(&free_space_complement(free_space), &faces)?;
    let get = |mask: &NodeMask, i: usize| {
        let [_, ny, nz] = counts;
        mask.contains([i / nz / ny, i / nz % ny, i % nz])
    };
    let state = |i: usize| match (get(&touched, i), get(&outside, i)) {
        (false, _) => Macro::Empty,
        (true, false) => Macro::Open,
        (true, true) => Macro::Masked,
    };
    Ok((0..counts.iter().product()).map(state).collect())
}

/// The mask whose inside is the other's outside, at its nodes.
fn free_space_complement(free_space: &FreeSpace) -> FreeSpace {
    let lookup = match &free_space.lookup {
        Lookup::Nearest(inside) => Lookup::Nearest(inside.iter().map(|inside| !inside).collect()),
        Lookup::Trilinear { values, threshold } => {
            let outside = |value: &f32| f32::from(u8::from(value < threshold));
            Lookup::Trilinear { values: values.iter().map(outside).collect(), threshold: 1.0 }
        }
    };
    FreeSpace { lookup, ..free_space.clone() }
}
