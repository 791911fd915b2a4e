//! A model at positions of the world.

use std::sync::Arc;

use super::file::{Nerfacto, NerfactoFile};
use crate::base::error::Result;
use crate::nested::{ColoredWorld, World};
use crate::network::Colors;
use crate::packets::{Directions, FieldScratch, Found};

/// Resolved cells along an edge of the tables' cube. Finer levels add details that few pictures
/// show, and a bake with more nodes than this reads them point by point.
const CELLS: f64 = 256.0;

/// A model, for sampling by boxes.
#[derive(Debug)]
pub(super) struct NerfactoWorld(pub(super) Arc<NerfactoFile>);

impl World for NerfactoWorld {
    type Loaded = Nerfacto;

    fn load(&self) -> Result<Arc<Nerfacto>> {
        self.0.load()
    }

    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.0.digest(hash)
    }

    fn detail(&self, position: [f64; 3]) -> f64 {
        self.0.space.stretch(position) / CELLS
    }

    fn is_probed(&self) -> bool {
        true
    }

    fn densities(
        &self,
        model: &Nerfacto,
        positions: &[[f64; 3]],
        _: bool,
        densities: &mut Vec<f64>,
    ) {
        model.densities(positions, &mut FieldScratch::<f32>::default(), densities);
    }
}

impl ColoredWorld for NerfactoWorld {
    type Along = Directions<f32>;
    type Places = Found;

    fn along(&self, model: &Nerfacto, directions: &[[f64; 3]]) -> Self::Along {
        model.along(directions)
    }

    fn places(
        &self,
        model: &Nerfacto,
        positions: &[[f64; 3]],
        found: &mut Found,
        densities: &mut Vec<f64>,
    ) {
        found.fill(positions, |positions, scratch, places| {
            let packet = model.places(positions, scratch, places);
            densities.extend(packet.into_iter().take(positions.len()));
        });
    }

    fn colors(
        &self,
        model: &Nerfacto,
        along: &Self::Along,
        found: &mut Found,
        number: usize,
        colors: &mut Colors,
    ) {
        model.field.colors_of_found(along, found, number, colors);
    }
}
