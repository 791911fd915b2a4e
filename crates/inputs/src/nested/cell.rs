//! The points of a node's cell, whose mean is the node's value.

use super::world::World;
use crate::model::field::Lattice;

/// The density of points in cells.
#[derive(Debug, Clone, Copy)]
struct Filling {
    /// Points along an edge of a cell, at most.
    most: usize,
    /// A cell that is wider than the model's own by less than this share has one point.
    same: f64,
}

/// For models with stored values.
const READ: Filling = Filling { most: 4, same: 1e-3 };
/// For models that are slow to evaluate.
const PROBED: Filling = Filling { most: 2, same: 0.2 };

/// The points of a node's cell: a cube of points, or only the node's position if the model is not
/// finer than the box.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    middle: [f64; 3],
    /// Points along an edge.
    pub count: usize,
    step: f64,
}

impl Cell {
    /// The cell of a node.
    pub fn of<W: World>(world: &W, lattice: &Lattice, node: [usize; 3]) -> Self {
        let middle = lattice.position(node);
        let spacing = lattice.nodes.spacing(&lattice.bounds).into_iter().fold(0.0, f64::max);
        let detail = world.detail(middle);
        let Filling { most, same } = if world.is_probed() { PROBED } else { READ };
        if spacing <= detail * (1.0 + same) {
            return Self { middle, count: 1, step: 0.0 };
        }
        let width = (spacing * spacing - detail * detail).sqrt();
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        let count = ((width / detail).ceil() as usize).clamp(2, most);
        Self { middle, count, step: width / count as f64 }
    }

    /// A point, by its numbers along the axes.
    pub fn point(&self, numbers: [usize; 3]) -> [f64; 3] {
        let mut at = self.middle;
        for (at, number) in at.iter_mut().zip(numbers) {
            *at += ((number as f64 + 0.5) - 0.5 * self.count as f64) * self.step;
        }
        at
    }

    /// The numbers of all points; with `half`, of every other point, in a balanced pattern.
    pub fn numbers(&self, half: bool) -> impl Iterator<Item = [usize; 3]> + use<> {
        let (count, half) = (self.count, half && self.count > 1);
        let all =
            (0..count.pow(3)).map(move |at| [at / (count * count), at / count % count, at % count]);
        all.filter(move |[i, j, k]| !half || (i + j + k) % 2 == 0)
    }
}

/// All points of a node's cell, or every other one with `half`.
pub fn points<W: World>(
    world: &W,
    lattice: &Lattice,
    node: [usize; 3],
    half: bool,
) -> Vec<[f64; 3]> {
    let cell = Cell::of(world, lattice, node);
    cell.numbers(half).map(|numbers| cell.point(numbers)).collect()
}
