//! A scene of several unit cubes, at world positions.

use std::sync::Arc;

use super::evaluate::Ngp;
use super::file::NgpFile;
use crate::base::error::Result;
use crate::nested::{ColoredWorld, World};
use crate::network::Colors;
use crate::packets::{Directions, FieldScratch, Found};

/// Ratio of a cell's edge to the model's resolution.
const PER_CELL: f64 = 2.0;

/// A model, for sampling by boxes. The network has details at any distance; its useful resolution
/// is that of training, which grows with the occupancy cells.
#[derive(Debug)]
pub(super) struct NgpWorld(pub(super) Arc<NgpFile>);

impl World for NgpWorld {
    type Loaded = Ngp;

    fn load(&self) -> Result<Arc<Ngp>> {
        self.0.load()
    }

    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.0.digest(hash)
    }

    fn detail(&self, position: [f64; 3]) -> f64 {
        let frame = self.0.frame;
        self.0.occupancy.cell_edge(frame.to_cube(position)) / (PER_CELL * frame.scale)
    }

    fn densities(
        &self,
        model: &Ngp,
        positions: &[[f64; 3]],
        masked: bool,
        densities: &mut Vec<f64>,
    ) {
        let (first, frame) = (densities.len(), self.0.frame);
        densities.resize(first + positions.len(), 0.0);
        let (mut numbers, mut places) = (Vec::new(), Vec::new());
        for (number, position) in positions.iter().enumerate() {
            let at = frame.to_cube(*position);
            if self.0.occupancy.contains(at) || (!masked && self.0.shows(at)) {
                numbers.push(first + number);
                places.push(at);
            }
        }
        let mut found = Vec::with_capacity(places.len());
        model.densities(&places, &mut FieldScratch::<f32>::default(), &mut found);
        for (number, density) in numbers.into_iter().zip(found) {
            if let Some(out) = densities.get_mut(number) {
                *out = density * frame.scale;
            }
        }
    }
}

impl ColoredWorld for NgpWorld {
    type Along = Directions<f32>;
    type Places = Found;

    fn along(&self, model: &Ngp, directions: &[[f64; 3]]) -> Self::Along {
        model.along(directions)
    }

    fn places(
        &self,
        model: &Ngp,
        positions: &[[f64; 3]],
        found: &mut Found,
        densities: &mut Vec<f64>,
    ) {
        let NgpFile { frame, occupancy, .. } = &*self.0;
        found.fill(positions, |positions, scratch, places| {
            let in_cube = positions.iter().map(|position| frame.to_cube(*position));
            let in_cube: Vec<[f64; 3]> = in_cube.collect();
            let packet = model.places(&in_cube, scratch, places);
            densities.extend(in_cube.iter().zip(packet).map(|(at, density)| {
                if occupancy.contains(*at) { density * frame.scale } else { 0.0 }
            }));
        });
    }

    fn colors(
        &self,
        model: &Ngp,
        along: &Self::Along,
        found: &mut Found,
        number: usize,
        colors: &mut Colors,
    ) {
        model.field.colors_of_found(along, found, number, colors);
    }
}
