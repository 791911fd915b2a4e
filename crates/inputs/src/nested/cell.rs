//! The points of a node's cell that its values are means of.

use super::world::World;
use crate::model::field::Lattice;

/// Points along an edge of a cell, at most.
const MOST_POINTS: usize = 4;
/// A cell that is wider than the model's own by less than this share has one point.
const SAME: f64 = 1e-3;

/// The points of a node's cell: its own position where the model is not finer than the box. With
/// `half` every other one, as balanced.
pub fn points<W: World>(
    world: &W,
    lattice: &Lattice,
    node: [usize; 3],
    half: bool,
) -> Vec<[f64; 3]> {
    let middle = lattice.position(node);
    let spacing = lattice.nodes.spacing(&lattice.bounds).into_iter().fold(0.0, f64::max);
    let detail = world.detail(middle);
    if spacing <= detail * (1.0 + SAME) {
        return vec![middle];
    }
    let width = (spacing * spacing - detail * detail).sqrt();
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let count = ((width / detail).ceil() as usize).clamp(2, MOST_POINTS);
    let step = width / count as f64;
    let along = |at: usize| ((at as f64 + 0.5) - 0.5 * count as f64) * step;
    let mut found = Vec::with_capacity(count.pow(3));
    let [x, y, z] = middle;
    for i in 0..count {
        for j in 0..count {
            let rows = (0..count).filter(|k| !half || (i + j + k) % 2 == 0);
            found.extend(rows.map(|k| [x + along(i), y + along(j), z + along(k)]));
        }
    }
    found
}
