//! The world around a field's box: nested boxes with growing node distances.
//!
//! Level 0 spans the field's own box. A *shell* is the box of a coarser level that reaches farther:
//! box `k` holds box `k - 1`, and its nodes lie about twice as far apart. A shell shows what lies
//! outside the next smaller box. It has values at all of its nodes, so that nodes around the
//! smaller box's faces exist. Where the trained model is finer, a value is the average over the
//! cell of its node.
//!
//! Nothing is lost if every second node of a box is a node of the next box: [`Lattice::doubled`]
//! places boxes so, around one with an odd number of nodes along each axis.

use mipvog_format::container::is_around;

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
}

impl Lattice {
    /// A box with its nodes.
    pub const fn new(bounds: Bounds, nodes: Nodes) -> Self {
        Self { bounds, nodes }
    }

    /// A box around this one, twice as large, with an odd number of nodes close to this one's.
    pub fn doubled(&self) -> Self {
        let spacing = self.nodes.spacing(&self.bounds);
        let (mut bounds, mut nodes) = (self.bounds, self.nodes);
        for (axis, spacing) in spacing.into_iter().enumerate() {
            let (step, shared) = (2.0 * spacing, self.nodes.0[axis] / 2 + 1);
            let below = (self.nodes.0[axis] + 1 - shared) / 2;
            nodes.0[axis] = (shared + 2 * below) | 1;
            let low = f64::from(self.bounds.min[axis]) - below as f64 * step;
            bounds.min[axis] = low as f32;
            bounds.max[axis] = (low + (nodes.0[axis] - 1) as f64 * step) as f32;
        }
        Self { bounds, nodes }
    }

    /// The position of a node in world units.
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
        if is_around((self.bounds, self.nodes), (smaller.bounds, smaller.nodes)) {
            return Ok(());
        }
        let describe = |of: &Self| format!("{:?} to {:?}", of.bounds.min, of.bounds.max);
        let found = format!("{} with {:?} nodes", describe(self), self.nodes.0);
        let expected = format!(
            "a larger box around {} with {:?} nodes, whose nodes are 1.5 to 3 times as far apart",
            describe(smaller),
            smaller.nodes.0
        );
        Err(Error::malformed(place.clone(), found, expected))
    }
}

/// The values of a box around the field's own.
#[derive(Debug, Clone)]
pub struct Shell {
    /// The box and its nodes.
    pub lattice: Lattice,
    /// Raw density, in the field's form.
    pub density: Grid,
    /// Raw colour, in grids with the same channels as the field's.
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
            let mut smaller = Lattice::new(bounds, Nodes(sizes));
            for _ in 0..6 {
                let larger = smaller.doubled();
                larger.check_around(&smaller, &Place::File).expect("it fits");
                for axis in 0..3 {
                    let extents = [larger.bounds.extent()[axis], smaller.bounds.extent()[axis]];
                    assert!(extents[0] >= 1.99 * extents[1], "{sizes:?}: {extents:?}");
                    let spacing = larger.nodes.spacing(&larger.bounds)[axis];
                    let shift = f64::from(smaller.bounds.min[axis] - larger.bounds.min[axis]);
                    assert!((shift / spacing - (shift / spacing).round()).abs() < 1e-4);
                }
                smaller = larger;
            }
            assert!(smaller.check_around(&smaller, &Place::File).is_err());
        }
    }
}
