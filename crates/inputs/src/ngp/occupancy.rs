//! The occupied cells of the unit cube.

use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};

use super::frame::Frame;

/// Cells of the unit cube, a cube of them.
#[derive(Debug, Clone)]
pub(super) struct Occupancy {
    side: usize,
    /// In Morton order, x in the lowest bit.
    cells: Vec<bool>,
    crop: Crop,
}

/// The part of the unit cube that is shown.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum Crop {
    /// All of it.
    #[default]
    None,
    /// A box, from and to along each axis.
    Box([[f64; 2]; 3]),
    /// A box with axes of its own, which is not held to.
    LeftOut,
}

impl Occupancy {
    /// Of `side` cells along an edge, a power of 2; `cells` are in Morton order.
    pub(super) fn new(side: usize, cells: Vec<bool>) -> Self {
        Self { side, cells, crop: Crop::None }
    }

    /// The same, shown in part.
    pub(super) fn cropped(self, crop: Crop) -> Self {
        Self { crop, ..self }
    }

    /// The part that is shown.
    pub(super) fn crop(&self) -> Crop {
        self.crop
    }

    /// The part of the world in which samples count, if it is not all of the cube.
    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    pub(super) fn sampled(&self, frame: &Frame) -> Option<Bounds> {
        // The cube's axes are y, z and x of the world.
        let Crop::Box([y, z, x]) = self.crop else { return None };
        let whole = frame.bounds();
        let mut shown = whole;
        let faces = whole.min.into_iter().zip(whole.max);
        let axes = shown.min.iter_mut().zip(&mut shown.max).zip(faces).zip(frame.offset);
        for ((((low, high), (first, last)), offset), [from, to]) in axes.zip([x, y, z]) {
            let at = |at: f64| (((at - offset) / frame.scale) as f32).clamp(first, last);
            (*low, *high) = (at(from), at(to));
        }
        Some(shown)
    }

    /// True if a position, within a distance, is shown.
    fn shows(&self, position: [f64; 3], distance: f64) -> bool {
        let Crop::Box(shown) = self.crop else { return true };
        let mut axes = position.into_iter().zip(shown);
        axes.all(|(at, [low, high])| at >= low - distance && at <= high + distance)
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
            && self.shows(position, 0.0)
            && self.cell(position.map(|at| self.along(at)))
    }

    /// True if a cell within a distance of a position is occupied.
    pub(super) fn touches(&self, position: [f64; 3], distance: f64) -> bool {
        // Nodes beside the part that is shown shape what lies between them.
        if !self.shows(position, distance) {
            return false;
        }
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
