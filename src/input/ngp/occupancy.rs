//! The occupied cells of the unit cube.

use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::Nodes;

use super::frame::Frame;

/// Cells of the unit cube, a cube of them.
#[derive(Debug, Clone)]
pub(super) struct Occupancy {
    side: usize,
    /// In Morton order, x in the lowest bit.
    cells: Vec<bool>,
}

impl Occupancy {
    /// Of `side` cells along an edge, a power of 2; `cells` are in Morton order.
    pub(super) fn new(side: usize, cells: Vec<bool>) -> Self {
        Self { side, cells }
    }

    fn cell(&self, cell: [usize; 3]) -> bool {
        let mut number = 0;
        for bit in 0..usize::BITS / 3 {
            for (axis, at) in (0..).zip(cell) {
                number |= (at >> bit & 1) << (3 * bit + axis);
            }
        }
        self.cells.get(number).copied().unwrap_or(false)
    }

    /// True if a position, 0 to 1 along each axis, lies in an occupied cell.
    pub(super) fn contains(&self, position: [f64; 3]) -> bool {
        position.iter().all(|at| (0.0..=1.0).contains(at))
            && self.cell(position.map(|at| self.along(at)))
    }

    /// True if a cell within a distance of a position is occupied.
    pub(super) fn touches(&self, position: [f64; 3], distance: f64) -> bool {
        let [x, y, z] = position.map(|at| self.along(at - distance)..=self.along(at + distance));
        x.into_iter().any(|x| y.clone().any(|y| z.clone().any(|z| self.cell([x, y, z]))))
    }

    fn along(&self, at: f64) -> usize {
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        let cell = (at * self.side as f64) as usize;
        cell.min(self.side - 1)
    }

    /// The same as a mask of free space in the world.
    pub(super) fn free_space(&self, frame: &Frame) -> FreeSpace {
        let side = self.side;
        let mut inside = Vec::with_capacity(side.pow(3));
        for x in 0..side {
            for y in 0..side {
                inside.extend((0..side).map(|z| self.cell(Frame::turned([x, y, z]))));
            }
        }
        let cells = side as f64;
        FreeSpace {
            nodes: Nodes([side; 3]),
            scale: [cells * frame.scale; 3],
            shift: frame.offset.map(|offset| cells * offset - 0.5),
            lookup: Lookup::Nearest(inside),
        }
    }
}
