//! The world around a field's box: boxes around each other, whose nodes are ever farther apart.
//!
//! Level 0 spans the field's own box. A *shell* is the box of a coarser level that reaches farther:
//!
//! ```text
//! box k holds box k - 1, and its nodes lie twice as far apart
//! node i of box k - 1 is node inner + i / 2 of box k, for even i
//! ```
//!
//! So every second node of a box is one of the next box, the faces of a box lie on nodes of the next
//! one, and each box but the last has an odd number of nodes along each axis. A shell has values at
//! all of its nodes, those within the smaller box among them: averages over the cell of a node, as
//! far as the trained model is finer there.

use super::Grid;
use crate::base::error::{Error, Place, Result};
use crate::model::grid::{Bounds, Nodes};

/// A box with its nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// The box, with nodes on its faces.
    pub bounds: Bounds,
    /// Nodes along each axis.
    pub nodes: Nodes,
    /// The node at the lowest corner of the next smaller box; 0 for the first.
    pub inner: [usize; 3],
}

impl Lattice {
    /// The first box.
    pub const fn first(bounds: Bounds, nodes: Nodes) -> Self {
        Self { bounds, nodes, inner: [0; 3] }
    }

    /// Nodes of the next box that lie in this one.
    pub fn shared(&self) -> [usize; 3] {
        self.nodes.0.map(|size| size / 2 + 1)
    }

    /// A box twice as large with about as many nodes, an odd number of them, around this one.
    pub fn doubled(&self) -> Self {
        let (spacing, shared) = (self.nodes.spacing(&self.bounds), self.shared());
        // As many nodes on both sides: one more than half as many as are added in all.
        let inner = std::array::from_fn(|axis| (self.nodes.0[axis] + 1 - shared[axis]) / 2);
        let nodes = std::array::from_fn(|axis| shared[axis] + 2 * inner[axis]);
        let nodes = Nodes(nodes.map(|size: usize| size | 1));
        let mut bounds = self.bounds;
        for axis in 0..3 {
            let step = 2.0 * spacing[axis];
            let low = f64::from(self.bounds.min[axis]) - inner[axis] as f64 * step;
            bounds.min[axis] = low as f32;
            bounds.max[axis] = (low + (nodes.0[axis] - 1) as f64 * step) as f32;
        }
        Self { bounds, nodes, inner }
    }

    /// The position of a node.
    pub fn position(&self, node: [usize; 3]) -> [f64; 3] {
        let spacing = self.nodes.spacing(&self.bounds);
        std::array::from_fn(|axis| {
            f64::from(self.bounds.min[axis]) + node[axis] as f64 * spacing[axis]
        })
    }

    /// Refuses a box that does not fit around a smaller one.
    ///
    /// # Errors
    /// `Malformed`.
    pub fn check_around(&self, smaller: &Self, place: &Place) -> Result<()> {
        self.bounds.check(place)?;
        let (own, other) =
            (self.nodes.spacing(&self.bounds), smaller.nodes.spacing(&smaller.bounds));
        let fits = (0..3).all(|axis| {
            let low = self.position(self.inner)[axis] - f64::from(smaller.bounds.min[axis]);
            smaller.nodes.0[axis] % 2 == 1
                && self.inner[axis] + smaller.shared()[axis] <= self.nodes.0[axis]
                && (own[axis] - 2.0 * other[axis]).abs() <= ROUNDED * own[axis]
                && low.abs() <= ROUNDED * own[axis]
        });
        if fits {
            return Ok(());
        }
        let found = format!(
            "{:?} nodes in {:?} to {:?}, of which {:?} is the first of the smaller box",
            self.nodes.0, self.bounds.min, self.bounds.max, self.inner
        );
        let expected = "a box whose nodes are twice as far apart, every second node of the smaller \
                        box among them";
        Err(Error::malformed(place.clone(), found, expected))
    }
}

/// Corners are float32: nodes of two boxes coincide up to this share of their distance.
const ROUNDED: f64 = 1e-2;

/// The values of a box around the field's own.
#[derive(Debug, Clone)]
pub struct Shell {
    /// The box and its nodes.
    pub lattice: Lattice,
    /// Raw density, as the field's.
    pub density: Grid,
    /// Raw colour, in grids of as many channels as the field's.
    pub color: Vec<Grid>,
}

impl Shell {
    /// All grids, density first.
    pub fn grids(&self) -> impl Iterator<Item = &Grid> {
        std::iter::once(&self.density).chain(&self.color)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_double_around_each_other() {
        for sizes in [[65, 65, 65], [3, 5, 7], [9, 3, 33]] {
            let bounds = Bounds { min: [-1.0, 0.0, 2.0], max: [1.0, 0.5, 4.0] };
            let mut smaller = Lattice::first(bounds, Nodes(sizes));
            for _ in 0..6 {
                let larger = smaller.doubled();
                larger.check_around(&smaller, &Place::File).expect("it fits");
                for axis in 0..3 {
                    let extents = [larger.bounds.extent()[axis], smaller.bounds.extent()[axis]];
                    assert!(extents[0] >= 1.99 * extents[1], "{sizes:?}: {extents:?}");
                }
                smaller = larger;
            }
            let even = Lattice { nodes: Nodes(smaller.nodes.0.map(|size| size + 1)), ..smaller };
            assert!(even.doubled().check_around(&even, &Place::File).is_err());
        }
    }
}
