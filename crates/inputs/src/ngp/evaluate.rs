//! A model in memory, evaluated at positions in its unit cube.

use super::frame::Frame;
use crate::model::harmonics::basis_f64;
use crate::packets::{Directions, FieldScratch, HashField, Lanes, Number, Places};

/// Densities beyond this are opaque at any length.
const DENSEST: f64 = 1e30;

/// A table and its networks.
#[derive(Debug)]
pub(super) struct Ngp {
    pub(super) field: HashField,
    /// The table spans a cube of this many unit cubes along an edge, around the same middle.
    pub(super) reach: f64,
    /// Factor from density per model unit to density per edge of the unit cube.
    pub(super) per_edge: f64,
}

impl Ngp {
    /// Positions of the unit cube in that of the table.
    fn in_table(&self, positions: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let moved = |at: f64| (at - 0.5) / self.reach + 0.5;
        positions.iter().map(|position| position.map(moved)).collect()
    }

    fn per_edge(&self, density: f64) -> f64 {
        (self.per_edge * density).min(DENSEST)
    }

    /// Adds the optical depth of an edge of the unit cube at each position of it.
    pub(super) fn densities<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        densities: &mut Vec<f64>,
    ) {
        let first = densities.len();
        self.field.densities(&self.in_table(positions), scratch, densities);
        let added = densities.iter_mut().skip(first);
        added.for_each(|density| *density = self.per_edge(*density));
    }

    /// Evaluates the positions of a packet. Returns the optical depths of an edge.
    pub(super) fn places<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        places: &mut Places<T>,
    ) -> Lanes<f64> {
        let densities = self.field.places(&self.in_table(positions), scratch, places);
        densities.map(|density| self.per_edge(density))
    }

    /// Unit directions of the world, prepared.
    pub(super) fn along<T: Number>(&self, directions: &[[f64; 3]]) -> Directions<T> {
        let inputs: Vec<_> =
            directions.iter().map(|&direction| basis_f64(Frame::turned(direction))).collect();
        self.field.color.directions(&inputs)
    }
}
