//! Empty space that rays skip.
//!
//! The box is cut into *macro cells* of a few level-0 cells per side. A macro cell is *occupied* by
//! a level if a sample of that level can be visible in it. For each level, each macro cell has a
//! *skip distance*: the Chebyshev distance to the nearest occupied one, in macro cells. A ray skips
//! all closer macro cells at once.

use super::free_cells::touched_cells;
use super::skip_distance::distances;
use crate::base::error::Result;
use crate::model::baked::DensityDomain;
use crate::model::grid::{BlockGrid, Bounds, BoxFrame, Nodes};
use crate::model::scene::{Activation, FreeSpace, Lookup};

use super::interpolated_density;

/// Level-0 cells along a macro cell's edge in small boxes.
const LEAST_EDGE: usize = 2;
/// Maximum macro cells along an axis: more would not fit into a processor's caches.
const MAX_CELLS: usize = 128;
/// Macro cells along a brick's edge: a brick of bytes is a cache line.
const BRICK: usize = 4;

/// Rules of a macro cell for samples in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Macro {
    /// Empty, like all macro cells less than this skip distance away along every axis.
    Empty(usize),
    /// Samples count.
    Open,
    /// Samples count inside the free-space mask.
    Masked,
}

/// Macro cells of a field. Their bytes are in bricks of one cache line each, which usually contains
/// a ray's next macro cells.
#[derive(Debug, Clone)]
pub struct SkipGrid {
    counts: [usize; 3],
    /// Bricks along y and z.
    bricks: [usize; 2],
    /// Macro cells along the whole box, which the last ones may overhang.
    scale: [f64; 3],
    /// For each level, the skip distance of each macro cell, in bricks.
    skip_distances: Vec<Vec<u8>>,
    /// Macro cells in which only some positions are inside the free-space mask, in bricks.
    masked: Option<Vec<bool>>,
}

/// The place of a level's cells among the finest ones of a box: along each axis, the position of
/// the level's first node, and the number of finest cells per cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellPlace(pub [[f64; 2]; 3]);

impl CellPlace {
    /// For a level of `nodes` over the same box.
    pub fn same_box(nodes: Nodes, finest: Nodes) -> Self {
        let cells = |axis: usize| (finest.0[axis] - 1) as f64 / (nodes.0[axis] - 1) as f64;
        Self([0, 1, 2].map(|axis| [0.0, cells(axis)]))
    }

    /// For a level of `nodes` over the box `own`, among those of `finest` nodes over the box `of`.
    pub fn between(nodes: Nodes, own: &BoxFrame, finest: Nodes, of: &BoxFrame) -> Self {
        let along = |axis: usize| {
            let cells = (finest.0[axis] - 1) as f64 * of.scale[axis];
            let first = (own.offset[axis] - of.offset[axis]) * cells;
            [first, cells / (own.scale[axis] * (nodes.0[axis] - 1) as f64)]
        };
        Self([0, 1, 2].map(along))
    }
}

/// The macro cells that a level occupies.
pub struct OccupiedMacroCells {
    grid: BlockGrid,
    place: CellPlace,
    limit: f32,
    blocks: Vec<bool>,
}

impl OccupiedMacroCells {
    /// For a level of `nodes` with densities in `domain`, at a `place` of the box with `finest`
    /// nodes.
    pub fn new(
        nodes: Nodes,
        finest: Nodes,
        place: CellPlace,
        domain: DensityDomain,
        activation: &Activation,
    ) -> Self {
        let grid = BlockGrid { nodes, edge: macro_edge(finest) };
        let limit = interpolated_density(activation, domain, domain.invisible(activation));
        Self { grid, place, limit, blocks: vec![false; grid.total()] }
    }

    /// Marks the macro cells around node `at` if `density`, in its interpolated form, is visible.
    /// Only cells with lowest nodes in `first..end` along each axis are considered.
    #[inline]
    pub fn mark(&mut self, at: [usize; 3], density: f32, [first, end]: [[usize; 3]; 2]) {
        if density <= self.limit {
            return;
        }
        // A block may overhang the level. Its nodes outside are not corners.
        if (0..3).any(|axis| at[axis] > end[axis]) {
            return;
        }
        let (edge, [_, by, bz]) = (self.grid.edge, self.grid.counts());
        // The node is a corner of the cells at and below it.
        let range = |axis: usize| {
            let lowest = at[axis].saturating_sub(1).max(first[axis]);
            let highest = at[axis].min(end[axis] - 1);
            lowest / edge..highest / edge + 1
        };
        for x in range(0) {
            for y in range(1) {
                self.blocks[(x * by + y) * bz..][range(2)].fill(true);
            }
        }
    }

    /// The macro cells of the finest level, of `finest` nodes, that this level occupies.
    pub fn finish(self, finest: Nodes) -> Vec<bool> {
        mark_blocks(&self.blocks, self.grid, self.place, finest)
    }
}

impl SkipGrid {
    /// For level 0 of `nodes` nodes. `occupied[level]` marks the macro cells that only samples of
    /// that level occupy, z fastest.
    pub fn new(
        nodes: Nodes,
        bounds: &Bounds,
        free_space: Option<&FreeSpace>,
        occupied: &[Vec<bool>],
    ) -> Result<Self> {
        let counts = macro_counts(nodes);
        let scale = nodes.0.map(|size| (size - 1) as f64 / macro_edge(nodes) as f64);
        let masks = match free_space {
            Some(free_space) => Some(MaskedCells::new(free_space, bounds, nodes)?),
            None => None,
        };
        let touched = |i: usize| masks.as_ref().is_none_or(|masks| masks.touched[i]);
        let reachable = |level: &Vec<bool>| {
            let cells = level.iter().enumerate();
            let marked = cells.map(|(i, &occupied)| occupied && touched(i)).collect();
            in_bricks(&distances(marked, counts), counts)
        };
        let skip_distances = occupied.iter().map(reachable).collect();
        let masked = masks.map(|masks| in_bricks(&masks.partly, counts));
        let bricks = [1, 2].map(|axis| counts[axis].div_ceil(BRICK));
        Ok(Self { counts, bricks, scale, skip_distances, masked })
    }

    /// The macro cell of a position, `0..=1` along each axis.
    #[inline(always)]
    pub fn place(&self, position: [f64; 3]) -> [usize; 3] {
        let [x, y, z] = position;
        let along = |axis: usize, position: f64| {
            ((position * self.scale[axis]) as usize).min(self.counts[axis] - 1)
        };
        [along(0, x), along(1, y), along(2, z)]
    }

    /// The state of a macro cell for samples that read some of the levels from `finest` to
    /// `coarsest`.
    #[inline(always)]
    pub fn state(&self, [finest, coarsest]: [usize; 2], place: [usize; 3]) -> Macro {
        let at = in_brick(place, self.bricks);
        let levels = &self.skip_distances[finest..=coarsest];
        match levels.iter().map(|distances| distances[at]).min() {
            Some(distance @ 1..) => Macro::Empty(distance.into()),
            _ if self.masked.as_ref().is_some_and(|masked| masked[at]) => Macro::Masked,
            _ => Macro::Open,
        }
    }

    /// The faces along the ray `start + k * step`, in positions `0..=1`.
    pub fn faces(&self, start: [f64; 3], step: [f64; 3]) -> Faces {
        let along = |axis: usize| {
            // The ray never leaves along an axis without motion.
            if step[axis] == 0.0 {
                return [0.0, f64::INFINITY];
            }
            let cell = 1.0 / (self.scale[axis] * step[axis]);
            let ahead = if cell < 0.0 { cell } else { 0.0 };
            [cell, ahead - start[axis] / step[axis]]
        };
        Faces([0, 1, 2].map(along))
    }
}

/// A ray's crossings with the faces of macro cells: along each axis, the index increment between
/// faces, and the index at which the ray leaves the first macro cell, minus that increment.
#[derive(Debug, Clone, Copy)]
pub struct Faces([[f64; 2]; 3]);

impl Faces {
    /// The smallest index at which the ray has left a macro cell and all those less than `distance`
    /// away, on a face ahead. Infinity without motion.
    #[inline(always)]
    pub fn leaves(&self, place: [usize; 3], distance: usize) -> f64 {
        let distance = distance as f64;
        let along = |axis: usize| {
            let [cell, first] = self.0[axis];
            place[axis] as f64 * cell + distance * cell.abs() + first
        };
        along(0).min(along(1)).min(along(2))
    }
}

/// The index of a macro cell, brick after brick, with these numbers of bricks along y and z.
#[inline(always)]
fn in_brick([x, y, z]: [usize; 3], [by, bz]: [usize; 2]) -> usize {
    let brick = (x / BRICK * by + y / BRICK) * bz + z / BRICK;
    ((brick * BRICK + x % BRICK) * BRICK + y % BRICK) * BRICK + z % BRICK
}

/// Values of macro cells, z fastest, in bricks.
fn in_bricks<T: Copy + Default>(values: &[T], [nx, ny, nz]: [usize; 3]) -> Vec<T> {
    let [bx, by, bz] = [nx, ny, nz].map(|count| count.div_ceil(BRICK));
    let mut bricks = vec![T::default(); bx * by * bz * BRICK.pow(3)];
    for (i, &value) in values.iter().enumerate() {
        bricks[in_brick([i / nz / ny, i / nz % ny, i % nz], [by, bz])] = value;
    }
    bricks
}

/// Level-0 cells along a macro cell's edge, for level 0 of `nodes`.
fn macro_edge(nodes: Nodes) -> usize {
    let cells = nodes.0.into_iter().max().unwrap_or(2) - 1;
    cells.div_ceil(MAX_CELLS).max(LEAST_EDGE)
}

fn macro_counts(nodes: Nodes) -> [usize; 3] {
    nodes.0.map(|size| (size - 1).div_ceil(macro_edge(nodes)))
}

/// Marks the macro cells that overlap a level's marked blocks; a block has the cells of its nodes
/// as lowest nodes.
fn mark_blocks(
    blocks: &[bool],
    grid: BlockGrid,
    CellPlace(place): CellPlace,
    finest: Nodes,
) -> Vec<bool> {
    let (counts, macro_edge) = (macro_counts(finest), macro_edge(finest));
    let BlockGrid { nodes, edge } = grid;
    // First and one past the last macro cell that block i of an axis overlaps.
    let range = |axis: usize, i: usize| {
        let [first, cells] = place[axis].map(|cells| cells / macro_edge as f64);
        let low = first + (i * edge) as f64 * cells;
        let high = first + ((i + 1) * edge).min(nodes.0[axis] - 1) as f64 * cells;
        // Ends are multiples of 1 / (macro edge * cells), so rounding is less than this: cells that
        // only touch do not overlap.
        let (start, end) = ((low + 1e-9) as usize, (high - 1e-9).ceil() as usize);
        // A block outside the box overlaps none.
        (start.min(end).min(counts[axis]), end.min(counts[axis]))
    };
    let mut marked = vec![false; counts.iter().product()];
    for (block, _) in blocks.iter().enumerate().filter(|(_, marked)| **marked) {
        let [_, by, bz] = grid.counts();
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

/// The macro cells that the free-space mask cuts.
struct MaskedCells {
    /// Any position of the macro cell is inside the mask.
    touched: Vec<bool>,
    /// Some positions are inside and some are not.
    partly: Vec<bool>,
}

impl MaskedCells {
    fn new(free_space: &FreeSpace, bounds: &Bounds, nodes: Nodes) -> Result<Self> {
        let counts = macro_counts(nodes);
        let faces: [Vec<f64>; 3] = [0, 1, 2].map(|axis| {
            let (min, spacing) = (f64::from(bounds.min[axis]), nodes.spacing(bounds)[axis]);
            let node = |i: usize| (i * macro_edge(nodes)).min(nodes.0[axis] - 1) as f64;
            (0..=counts[axis]).map(|i| min + node(i) * spacing).collect()
        });
        let touched = touched_cells(free_space, &faces)?;
        let beyond = [0, 1, 2].map(|axis| beyond_nodes(free_space, axis, &faces[axis]));
        let is_beyond = |at: [usize; 3]| (0..3).any(|axis| beyond[axis][at[axis]]);
        let outside = touched_cells(&free_space_complement(free_space), &faces)?;
        let cells = |get: &dyn Fn([usize; 3]) -> bool| {
            let [nx, ny, nz] = counts;
            (0..nx * ny * nz).map(|i| get([i / nz / ny, i / nz % ny, i % nz])).collect()
        };
        Ok(Self {
            touched: cells(&|at| touched.contains(at)),
            partly: cells(&|at| touched.contains(at) && (outside.contains(at) || is_beyond(at))),
        })
    }
}

/// For each range between `faces` along an axis, whether it extends beyond the mask's nodes, where
/// everything is outside.
fn beyond_nodes(free_space: &FreeSpace, axis: usize, faces: &[f64]) -> Vec<bool> {
    // The last node's region ends half a node further.
    let margin = match free_space.lookup {
        Lookup::Nearest(_) => 0.5,
        Lookup::Trilinear { .. } => 0.0,
    };
    let last = (free_space.nodes.0[axis] - 1) as f64 + margin;
    let is_within = |face: &f64| {
        let at = face * free_space.scale[axis] + free_space.shift[axis];
        (-margin..=last).contains(&at)
    };
    faces.windows(2).map(|range| !range.iter().all(is_within)).collect()
}

/// The inverse of a mask, at its nodes.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_that_reach_beyond_a_mask_are_divided_by_it() {
        let bounds = Bounds { min: [0.0; 3], max: [8.0; 3] };
        let nodes = Nodes([9; 3]);
        // Nodes at 1, 3, 5 and 7 along x; at the faces of the box along the other axes.
        for (lookup, divided) in [
            (Lookup::Nearest(vec![true; 16]), [false; 4]),
            (
                Lookup::Trilinear { values: vec![1.0; 16], threshold: 0.5 },
                [true, false, false, true],
            ),
        ] {
            for (scale, shift) in [(0.5, -0.5), (-0.5, 3.5)] {
                let mask = FreeSpace {
                    nodes: Nodes([4, 2, 2]),
                    scale: [scale, 0.125, 0.125],
                    shift: [shift, 0.0, 0.0],
                    lookup: lookup.clone(),
                };
                let edge = macro_edge(nodes);
                assert_eq!(edge, 2);
                let cells = MaskedCells::new(&mask, &bounds, nodes).expect("no error");
                for (i, partly) in cells.partly.iter().enumerate() {
                    let [x, y, z] = [i / 16, i / 4 % 4, i % 4];
                    let share = |at: usize, by: f64| (at as f64 + by) * edge as f64;
                    let inside = [0.01, 0.5, 0.99]
                        .map(|by| mask.contains([share(x, by), share(y, 0.5), share(z, 0.5)]));
                    assert_eq!(inside.contains(&false), divided[x], "{x}");
                    assert_eq!(*partly, divided[x], "{x} {y} {z}");
                }
            }
        }
    }
}
