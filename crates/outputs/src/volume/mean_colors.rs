//! Mean colours at the nodes of a level, and between them.
//!
//! A view network takes a millisecond for all directions of a point. So it is evaluated only at
//! nodes that are occupied or have an occupied neighbour, and colours are interpolated between
//! nodes.

use std::collections::HashMap;

use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::Progress;
use crate::model::grid::Nodes;
use crate::view::render::{BEFORE, Directions, Renderer};

/// Nodes along the edge of a block of colours. Densities around a block are computed per block, so
/// small blocks compute most of them several times.
const EDGE: usize = 16;
/// Nodes along the edge of a part of a block and its surroundings that is skipped if it is empty.
const PART: usize = 4;
/// Colours of the nodes of a block, followed by 1, or 0 for nodes without a colour.
type Block = Vec<[f32; 4]>;

/// Mean colours, display-referred.
#[derive(Debug)]
pub struct MeanColors {
    nodes: Nodes,
    blocks: HashMap<[usize; 3], Block>,
}

impl MeanColors {
    /// Computes the colours of a level's nodes. Nodes with densities below `least` (optical depth
    /// per world unit) at themselves and all neighbours have none.
    ///
    /// # Errors
    ///
    /// A request to stop.
    pub fn new(
        field: &Renderer,
        level: usize,
        nodes: Nodes,
        least: f32,
        directions: &Directions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let reach = Nearby::reach(field, nodes);
        let counts = nodes.0.map(|size| size.div_ceil(EDGE));
        let share = |at: [usize; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| at[axis] as f64 / (nodes.0[axis] - 1) as f64)
        };
        let blocks = parallel::map(counts.iter().product(), |number| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let at = [number / counts[2] / counts[1], number / counts[2] % counts[1], number];
            let at = [at[0], at[1], at[2] % counts[2]];
            let first = at.map(|at| at * EDGE);
            // One more node on each side.
            let around = first.map(|first| first.saturating_sub(1));
            let end: [usize; 3] =
                std::array::from_fn(|axis| (first[axis] + EDGE + 1).min(nodes.0[axis]));
            if field.is_empty([share(around), share(end.map(|end| end - 1))], level) {
                return Ok(None);
            }
            let near = Nearby::new(field, level, nodes, first, reach);
            let mut block = vec![[0.0; 4]; EDGE.pow(3)];
            for (i, color) in block.iter_mut().enumerate() {
                let inside = [i / EDGE / EDGE, i / EDGE % EDGE, i % EDGE];
                let node: [usize; 3] = std::array::from_fn(|axis| first[axis] + inside[axis]);
                if (0..3).all(|axis| node[axis] < nodes.0[axis]) && near.any_around(node, least) {
                    let [red, green, blue] =
                        field.mean_color_behind(share(node), level, directions, |at| near.at(at));
                    *color = [red, green, blue, 1.0];
                }
            }
            Ok(Some((at, block)))
        })?;
        Ok(Self { nodes, blocks: blocks.into_iter().flatten().collect() })
    }

    /// The colour at a place in shares of the box.
    pub fn at(&self, share: [f64; 3]) -> [f32; 3] {
        let Nodes(sizes) = self.nodes;
        let at: [f64; 3] = std::array::from_fn(|axis| share[axis] * (sizes[axis] - 1) as f64);
        let low: [usize; 3] =
            std::array::from_fn(|axis| (at[axis] as usize).min(sizes[axis].saturating_sub(2)));
        let home = low.map(|node| node / EDGE);
        let own = self.blocks.get(&home);
        let mut sum = [0.0f32; 4];
        for corner in 0..8usize {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight = (0..3).fold(1.0, |weight, axis| {
                let fraction = (at[axis] - low[axis] as f64) as f32;
                weight * if up[axis] == 1 { fraction } else { 1.0 - fraction }
            });
            if weight == 0.0 {
                continue;
            }
            let node: [usize; 3] = std::array::from_fn(|axis| low[axis] + up[axis]);
            let there = node.map(|node| node / EDGE);
            // Most corners are in the same block.
            let block = if there == home { own } else { self.blocks.get(&there) };
            let Some(block) = block else { continue };
            let [x, y, z] = node.map(|node| node % EDGE);
            let color = block[(x * EDGE + y) * EDGE + z];
            // Nodes without a colour have weight 0.
            for (sum, value) in sum.iter_mut().zip(color) {
                *sum += weight * value;
            }
        }
        let [red, green, blue, weight] = sum;
        [red, green, blue].map(|sum| if weight > 0.0 { sum / weight } else { 0.0 })
    }
}

/// The densities of a block's nodes and of those around it; a node's colour needs a hundred.
struct Nearby {
    nodes: Nodes,
    first: [usize; 3],
    sides: [usize; 3],
    /// Optical depth per world unit.
    densities: Vec<f32>,
}

impl Nearby {
    /// Nodes on each side of a block that its colours need.
    fn reach(field: &Renderer, Nodes(sizes): Nodes) -> [usize; 3] {
        let view = field.view();
        let (back, extent) =
            (f64::from(BEFORE) * f64::from(view.march.voxel_size), view.bounds.extent());
        std::array::from_fn(|axis| {
            let nodes = back / extent[axis] * (sizes[axis] - 1) as f64;
            (nodes.ceil() as usize + 1).min(sizes[axis])
        })
    }

    fn new(
        field: &Renderer,
        level: usize,
        nodes: Nodes,
        block: [usize; 3],
        reach: [usize; 3],
    ) -> Self {
        let first: [usize; 3] = std::array::from_fn(|axis| block[axis].saturating_sub(reach[axis]));
        let sides: [usize; 3] = std::array::from_fn(|axis| {
            (block[axis] + EDGE + reach[axis]).min(nodes.0[axis]) - first[axis]
        });
        let share = |inside: [usize; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| {
                (first[axis] + inside[axis]) as f64 / (nodes.0[axis] - 1) as f64
            })
        };
        let mut densities = vec![0.0; sides.iter().product()];
        let parts = sides.map(|side| side.div_ceil(PART));
        for number in 0..parts.iter().product() {
            let part = [number / parts[2] / parts[1], number / parts[2] % parts[1], number];
            let start = [part[0], part[1], part[2] % parts[2]].map(|part| part * PART);
            let end: [usize; 3] = std::array::from_fn(|axis| (start[axis] + PART).min(sides[axis]));
            if field.is_empty([share(start), share(end.map(|end| end - 1))], level) {
                continue;
            }
            for (x, y) in (start[0]..end[0]).flat_map(|x| (start[1]..end[1]).map(move |y| (x, y))) {
                for z in start[2]..end[2] {
                    densities[(x * sides[1] + y) * sides[2] + z] =
                        field.density_at(share([x, y, z]), level);
                }
            }
        }
        Self { nodes, first, sides, densities }
    }

    /// The density of a node; 0 outside the block.
    fn node(&self, node: [i64; 3]) -> f32 {
        let mut place = 0;
        for ((at, first), side) in node.into_iter().zip(self.first).zip(self.sides) {
            let inside = usize::try_from(at - first as i64).ok().filter(|at| *at < side);
            let Some(inside) = inside else { return 0.0 };
            place = place * side + inside;
        }
        self.densities[place]
    }

    /// True if the density of a node or one of its neighbours reaches the threshold.
    fn any_around(&self, node: [usize; 3], least: f32) -> bool {
        (0..27).any(|step| {
            let steps = [step / 9, step / 3 % 3, step % 3];
            self.node(std::array::from_fn(|axis| node[axis] as i64 + steps[axis] - 1)) >= least
        })
    }

    /// The density at the node that is nearest to a place in shares of the box.
    fn at(&self, share: [f64; 3]) -> f32 {
        self.node(std::array::from_fn(|axis| {
            libm::rint(share[axis] * (self.nodes.0[axis] - 1) as f64) as i64
        }))
    }
}
