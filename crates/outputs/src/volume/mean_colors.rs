//! Mean colours at the nodes of a level, and between them.
//!
//! A view network takes a millisecond for all directions of a point. So it is evaluated only at
//! nodes that are occupied or have an occupied neighbour, and colours are interpolated between
//! nodes.

use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::Progress;
use crate::model::grid::Nodes;
use crate::view::render::{Directions, Renderer};

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
    /// Blocks along each axis.
    counts: [usize; 3],
    /// All blocks, x slowest; empty ones are `None`.
    blocks: Vec<Option<Block>>,
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
        let surroundings = Surroundings::new(directions, nodes);
        let counts = nodes.0.map(|size| size.div_ceil(EDGE));
        let share = |at: [usize; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| at[axis] as f64 / (nodes.0[axis] - 1) as f64)
        };
        let blocks = parallel::map(counts.iter().product(), |number| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let at = place(number, counts);
            let first = at.map(|at| at * EDGE);
            // One more node on each side.
            let around = first.map(|first| first.saturating_sub(1));
            let end: [usize; 3] =
                std::array::from_fn(|axis| (first[axis] + EDGE + 1).min(nodes.0[axis]));
            if field.is_empty([share(around), share(end.map(|end| end - 1))], level) {
                return Ok(None);
            }
            let near = surroundings.densities(field, level, nodes, first);
            let mut block = vec![[0.0; 4]; EDGE.pow(3)];
            for (i, color) in block.iter_mut().enumerate() {
                let inside = place(i, [EDGE; 3]);
                let node: [usize; 3] = std::array::from_fn(|axis| first[axis] + inside[axis]);
                if (0..3).any(|axis| node[axis] >= nodes.0[axis]) {
                    continue;
                }
                let home = surroundings.number(inside);
                if surroundings.around.iter().any(|by| near[home.wrapping_add(*by)] >= least) {
                    let density_at = |direction: usize, place: usize| {
                        let by = surroundings.before[direction][place];
                        by.map_or(0.0, |by: usize| near[home.wrapping_add(by)])
                    };
                    let [red, green, blue] =
                        field.mean_color_behind(share(node), level, directions, density_at);
                    *color = [red, green, blue, 1.0];
                }
            }
            Ok(Some(block))
        })?;
        Ok(Self { nodes, counts, blocks })
    }

    /// The colour at a place in shares of the box.
    pub fn at(&self, share: [f64; 3]) -> [f32; 3] {
        let Nodes(sizes) = self.nodes;
        let at: [f64; 3] = std::array::from_fn(|axis| share[axis] * (sizes[axis] - 1) as f64);
        let low: [usize; 3] =
            std::array::from_fn(|axis| (at[axis] as usize).min(sizes[axis].saturating_sub(2)));
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
            let [x, y, z] = node.map(|node| node / EDGE);
            let number = (x * self.counts[1] + y) * self.counts[2] + z;
            let Some(Some(block)) = self.blocks.get(number) else { continue };
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

/// A block's nodes and those around it, whose densities its colours need: a hundred a node.
struct Surroundings {
    /// Nodes around the block, on each side.
    reach: [usize; 3],
    /// Nodes along each axis, with those around the block.
    sides: [usize; 3],
    /// Steps from a node's number to those of its neighbours and itself. Steps back wrap around.
    around: Vec<usize>,
    /// By direction, steps to the nodes in front; `None` beyond the grid.
    before: Vec<Vec<Option<usize>>>,
}

impl Surroundings {
    fn new(directions: &Directions, Nodes(sizes): Nodes) -> Self {
        // The nearest node to each place, in steps along each axis.
        let nearest = |place: &[f64; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| libm::rint(place[axis] * (sizes[axis] - 1) as f64))
        };
        let places = directions.places();
        let mut reach = [1; 3];
        for steps in places.iter().flatten().map(nearest) {
            for axis in 0..3 {
                reach[axis] = reach[axis].max(steps[axis].abs() as usize).min(sizes[axis]);
            }
        }
        let sides = reach.map(|reach| EDGE + 2 * reach);
        let number = |steps: [i64; 3]| -> usize {
            let [x, y, z] = steps;
            ((x * sides[1] as i64 + y) * sides[2] as i64 + z) as usize
        };
        let around = (0..27).map(|step| number([step / 9 - 1, step / 3 % 3 - 1, step % 3 - 1]));
        let before = places.iter().map(|places| {
            let within =
                |steps: &[f64; 3]| (0..3).all(|axis| steps[axis].abs() <= reach[axis] as f64);
            let steps = places.iter().map(nearest);
            steps.map(|at| within(&at).then(|| number(at.map(|at| at as i64)))).collect()
        });
        let (around, before) = (around.collect(), before.collect());
        Self { reach, sides, around, before }
    }

    /// The number of a block's node.
    fn number(&self, inside: [usize; 3]) -> usize {
        let [x, y, z] = std::array::from_fn(|axis| inside[axis] + self.reach[axis]);
        (x * self.sides[1] + y) * self.sides[2] + z
    }

    /// The densities of a block and around it, in optical depth per world unit; 0 outside the grid.
    fn densities(
        &self,
        field: &Renderer,
        level: usize,
        nodes: Nodes,
        block: [usize; 3],
    ) -> Vec<f32> {
        let share = |node: [usize; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| node[axis] as f64 / (nodes.0[axis] - 1) as f64)
        };
        let mut densities = vec![0.0; self.sides.iter().product()];
        let (mut places, mut shares) = (Vec::new(), Vec::new());
        // The part of the surroundings that is in the grid, from the first node on.
        let low: [usize; 3] =
            std::array::from_fn(|axis| block[axis].saturating_sub(self.reach[axis]));
        let high: [usize; 3] =
            std::array::from_fn(|axis| (block[axis] + EDGE + self.reach[axis]).min(nodes.0[axis]));
        let parts: [usize; 3] = std::array::from_fn(|axis| (high[axis] - low[axis]).div_ceil(PART));
        for number in 0..parts.iter().product() {
            let part = place(number, parts);
            let start: [usize; 3] = std::array::from_fn(|axis| low[axis] + part[axis] * PART);
            let end: [usize; 3] = std::array::from_fn(|axis| (start[axis] + PART).min(high[axis]));
            if field.is_empty([share(start), share(end.map(|end| end - 1))], level) {
                continue;
            }
            let sides: [usize; 3] = std::array::from_fn(|axis| end[axis] - start[axis]);
            places.clear();
            shares.clear();
            for number in 0..sides.iter().product() {
                let inside = place(number, sides);
                let node: [usize; 3] = std::array::from_fn(|axis| start[axis] + inside[axis]);
                let [x, y, z] =
                    std::array::from_fn(|axis| node[axis] + self.reach[axis] - block[axis]);
                places.push((x * self.sides[1] + y) * self.sides[2] + z);
                shares.push(share(node));
            }
            for (&at, density) in places.iter().zip(field.densities_at(&shares, level)) {
                densities[at] = density;
            }
        }
        densities
    }
}

/// The place of a number in a box of this many places, z fastest.
fn place(number: usize, [_, y, z]: [usize; 3]) -> [usize; 3] {
    [number / z / y, number / z % y, number % z]
}
