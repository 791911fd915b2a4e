//! A scene of several unit cubes at positions of the world.

use std::sync::Arc;

use super::evaluate::{Ngp, harmonics};
use super::file::NgpFile;
use super::perceptron::{LANES, Lanes};
use crate::base::error::Result;
use crate::model::harmonics::FUNCTIONS;
use crate::nested::{ColoredWorld, World};
use crate::network::Colors;

/// Edges of cells over the distance at which values are told apart.
const PER_CELL: f64 = 2.0;

/// A model as boxes sample it. The network has details at any distance; what counts are those that
/// training saw, which grow with the cells of occupied space.
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
        let mut found = |numbers: &mut Vec<usize>, places: &mut Vec<[f64; 3]>| {
            let values = model.densities(&model.geometry(places));
            for (number, density) in numbers.drain(..).zip(values) {
                if let Some(out) = densities.get_mut(first + number) {
                    *out = density * frame.scale;
                }
            }
            places.clear();
        };
        let (mut numbers, mut places) = (Vec::new(), Vec::new());
        for (number, position) in positions.iter().enumerate() {
            let at = frame.to_cube(*position);
            if masked && !self.0.occupancy.contains(at) {
                continue;
            }
            numbers.push(number);
            places.push(at);
            if places.len() == LANES {
                found(&mut numbers, &mut places);
            }
        }
        if !places.is_empty() {
            found(&mut numbers, &mut places);
        }
    }
}

impl ColoredWorld for NgpWorld {
    /// The directions' number, and their harmonics.
    type Along = (usize, Vec<[Lanes; FUNCTIONS]>);

    fn along(&self, _: &Ngp, directions: &[[f64; 3]]) -> Self::Along {
        (directions.len(), harmonics(directions))
    }

    fn colors(
        &self,
        model: &Ngp,
        (count, directions): &Self::Along,
        position: [f64; 3],
        colors: &mut Colors,
    ) {
        let geometry = model.geometry(&[self.0.frame.to_cube(position)]);
        colors.iter_mut().for_each(Vec::clear);
        for color in model.colors_along(&geometry, 0, directions).iter().take(*count) {
            colors.iter_mut().zip(color).for_each(|(out, value)| out.push(*value));
        }
    }
}
