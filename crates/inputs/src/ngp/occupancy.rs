//! The occupied cells of the unit cube, and of cubes around it, each twice as large.

use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};

use super::frame::Frame;

/// Cells of nested cubes, the same number in each.
#[derive(Debug, Clone)]
pub(super) struct Occupancy {
    side: usize,
    /// The edge of the last cube, which need not be twice the one before.
    span: f64,
    /// By cube, in Morton order with x in the lowest bit; the unit cube is the first.
    cubes: Vec<Vec<bool>>,
    crop: Crop,
}

/// The rendered part of the unit cube.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum Crop {
    /// All of it.
    #[default]
    None,
    /// A box, from and to along each axis.
    Box([[f64; 2]; 3]),
    /// A rotated box, which is ignored.
    LeftOut,
}

impl Occupancy {
    /// With `side` cells along an edge of each cube, a power of 2, in Morton order. The last cube's
    /// edge is `span`.
    pub(super) fn new(side: usize, span: f64, cubes: Vec<Vec<bool>>) -> Self {
        Self { side, span, cubes, crop: Crop::None }
    }

    /// The same, rendered in part.
    pub(super) fn cropped(self, crop: Crop) -> Self {
        Self { crop, ..self }
    }

    /// The rendered part.
    pub(super) fn crop(&self) -> Crop {
        self.crop
    }

    /// The part of the world in which samples count, unless it is the whole cube.
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

    /// True if a position is rendered, or within a distance of the rendered part.
    fn shows(&self, position: [f64; 3], distance: f64) -> bool {
        let Crop::Box(shown) = self.crop else { return true };
        let mut axes = position.into_iter().zip(shown);
        axes.all(|(at, [low, high])| at >= low - distance && at <= high + distance)
    }

    /// The number of the smallest cube around a position; the number of cubes for positions beyond
    /// all.
    fn cube(&self, position: [f64; 3]) -> usize {
        let farthest = position.iter().fold(0.0, |most: f64, at| most.max((at - 0.5).abs()));
        let holds = |number: &usize| farthest <= 0.5 * self.edge(*number);
        (0..self.cubes.len()).find(holds).unwrap_or(self.cubes.len())
    }

    /// The edge of a cube.
    fn edge(&self, number: usize) -> f64 {
        libm::exp2(number as f64).min(self.span)
    }

    /// The edge of a cell at a position, in edges of the unit cube.
    pub(super) fn cell_edge(&self, position: [f64; 3]) -> f64 {
        self.edge(self.cube(position)) / self.side as f64
    }

    fn cell(&self, cube: usize, cell: [usize; 3]) -> bool {
        let mut number = 0;
        for bit in 0..usize::BITS / 3 {
            for (axis, at) in (0..).zip(cell) {
                number |= (at >> bit & 1) << (3 * bit + axis);
            }
        }
        self.cubes.get(cube).and_then(|cells| cells.get(number)).copied().unwrap_or(false)
    }

    /// True if a position, in edges of the unit cube, lies in an occupied cell.
    pub(super) fn contains(&self, position: [f64; 3]) -> bool {
        self.contains_in(position, self.cube(position))
    }

    /// The same for a sample with a step length: its cell must be longer than the step, so it may
    /// be one of a larger cube.
    pub(super) fn contains_by_step(&self, position: [f64; 3], step: f64) -> bool {
        let cells = step * self.side as f64;
        let is_short = |number: &usize| cells < libm::exp2(*number as f64);
        let last = self.cubes.len().saturating_sub(1);
        let least = (0..last).find(is_short).unwrap_or(last);
        self.contains_in(position, self.cube(position).max(least))
    }

    fn contains_in(&self, position: [f64; 3], cube: usize) -> bool {
        let edge = self.edge(cube);
        position.iter().all(|at| at.is_finite())
            && self.shows(position, 0.0)
            && self.cell(cube, position.map(|at| self.along((at - 0.5) / edge + 0.5)))
    }

    /// True if a cell within a distance of a position is occupied.
    pub(super) fn touches(&self, position: [f64; 3], distance: f64) -> bool {
        // Nodes beside the rendered part affect interpolation in it.
        if !self.shows(position, distance) {
            return false;
        }
        // Rounding may place nodes of the outermost faces beyond them.
        let cube = self.cube(position).min(self.cubes.len().saturating_sub(1));
        let edge = self.edge(cube);
        let along = |at: f64| self.along((at - 0.5) / edge + 0.5);
        let [x, y, z] = position.map(|at| along(at - distance)..=along(at + distance));
        x.into_iter().any(|x| y.clone().any(|y| z.clone().any(|z| self.cell(cube, [x, y, z]))))
    }

    fn along(&self, at: f64) -> usize {
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        let cell = (at * self.side as f64) as usize;
        cell.min(self.side - 1)
    }

    /// The cells of the unit cube as a mask of free space in the world.
    pub(super) fn free_space(&self, frame: &Frame) -> FreeSpace {
        let side = self.side;
        let mut inside = Vec::with_capacity(side.pow(3));
        for x in 0..side {
            for y in 0..side {
                inside.extend((0..side).map(|z| self.cell(0, Frame::turned([x, y, z]))));
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
