//! A model in its file, and in memory.

use std::sync::Arc;

use super::keys::{Arrays, GridFile, LayerFile};
use super::settings::Settings;
use super::space::Space;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::harmonics::{FUNCTIONS, basis_f64};
use crate::packets::{
    Directions, FieldScratch, HashField, HashGrid, HashNetwork, LANES, Lanes, Layer, Number,
    Places, Real, Scratch, Values, ViewNetwork, gathered,
};

/// Densities beyond this are opaque at any length.
const DENSEST: f64 = 1e30;

/// The appearance for colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Appearance {
    /// The mean of all pictures'.
    Mean,
    /// Zeros.
    Zero,
    /// A picture's.
    Picture(usize),
}

/// A model whose arrays are read on first use.
#[derive(Debug)]
pub(super) struct NerfactoFile {
    pub(super) arrays: Arrays,
    pub(super) settings: Settings,
    pub(super) space: Space,
    pub(super) appearance: Appearance,
    pub(super) limits: Limits,
    pub(super) loaded: Lazy<Nerfacto>,
}

/// A model in memory.
#[derive(Debug)]
pub(super) struct Nerfacto {
    pub(super) field: HashField,
    proposals: Vec<HashNetwork>,
    space: Space,
    mean_density: f64,
    by_torch: bool,
}

impl NerfactoFile {
    /// The model in memory.
    pub(super) fn load(&self) -> Result<Arc<Nerfacto>> {
        self.loaded.get(|| self.read())
    }

    fn read(&self) -> Result<Nerfacto> {
        let mut budget = Budget::new(&self.limits);
        let Arrays { field, color, geometry, by_torch, proposals, .. } = &self.arrays;
        let appearance = self.appearance(&mut budget)?;
        let mut layers = read_layers(color, &mut budget)?;
        if let Some(first) = layers.first_mut() {
            // Colours use only one appearance; padded inputs are 1.
            let kept = FUNCTIONS + geometry;
            let mut constants = appearance;
            constants.resize(first.inputs.saturating_sub(kept), 1.0);
            *first = first.clone().with_constants(kept, &constants);
        }
        if let Some(last) = layers.last_mut() {
            last.weights.truncate(3 * last.inputs);
            last.biases.truncate(3);
        }
        let shape = grid(field, &mut budget)?;
        let color = ViewNetwork::new(&layers, [FUNCTIONS, 0]);
        let proposals = proposals.iter().map(|proposal| grid(proposal, &mut budget));
        Ok(Nerfacto {
            field: HashField { shape, color, skipped: 1 },
            proposals: proposals.collect::<Result<_>>()?,
            space: self.space,
            mean_density: self.settings.mean_density,
            by_torch: *by_torch,
        })
    }

    /// The appearance for colours; none for models without appearances.
    fn appearance(&self, budget: &mut Budget) -> Result<Vec<f64>> {
        let Some((values, [pictures, width])) = &self.arrays.appearances else {
            return Ok(Vec::new());
        };
        let mut sums = vec![0.0; *width];
        let (chosen, share) = match self.appearance {
            Appearance::Zero => return Ok(sums),
            Appearance::Mean => (0..*pictures, 1.0 / *pictures as f64),
            Appearance::Picture(number) => (number..number + 1, 1.0),
        };
        let stored = values.read(budget)?;
        let rows = stored.chunks_exact((*width).max(1)).skip(chosen.start).take(chosen.len());
        for row in rows {
            sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += f64::from(*value));
        }
        sums.iter_mut().for_each(|sum| *sum *= share);
        Ok(sums)
    }

    /// Bytes of the model in memory.
    pub(super) fn memory_bytes(&self) -> u64 {
        let tables = [&self.arrays.field].into_iter().chain(&self.arrays.proposals);
        tables.map(|grid| 4 * grid.table.count).sum()
    }

    /// Visits the bytes of all arrays.
    pub(super) fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let Arrays { field, color, proposals, appearances, .. } = &self.arrays;
        let mut all: Vec<&Values> = appearances.iter().map(|(values, _)| values).collect();
        let mut layers: Vec<&LayerFile> = color.iter().collect();
        for grid in [field].into_iter().chain(proposals) {
            all.push(&grid.table);
            layers.extend(&grid.layers);
        }
        for layer in layers {
            all.push(&layer.weights);
            all.extend(&layer.biases);
        }
        for values in all {
            values.digest(&mut Budget::new(&self.limits), hash)?;
        }
        hash(format!("{:?} {:?}", self.settings, self.appearance).as_bytes());
        Ok(())
    }
}

fn read_layers(files: &[LayerFile], budget: &mut Budget) -> Result<Vec<Layer>> {
    let read = files.iter().map(|file| {
        let weights = file.weights.read(budget)?;
        let biases = file.biases.as_ref().map(|biases| biases.read(budget)).transpose()?;
        Ok(match biases {
            None => Layer::unbiased(file.inputs, weights),
            Some(biases) => {
                let biases = biases.into_iter().map(f64::from).collect();
                Layer { inputs: file.inputs, weights, biases }
            }
        })
    });
    read.collect()
}

fn grid(file: &GridFile, budget: &mut Budget) -> Result<HashNetwork> {
    let mut layers = read_layers(&file.layers, budget)?;
    if let Some(first) = layers.first_mut() {
        let features = file.levels.width();
        let filler = if file.filled_with_ones { 1.0 } else { 0.0 };
        let constants = vec![filler; first.inputs.saturating_sub(features)];
        *first = first.clone().with_constants(features, &constants);
    }
    let grid = HashGrid { levels: file.levels.clone(), table: file.table.read(budget)? };
    Ok(HashNetwork::new(grid, &layers))
}

impl Nerfacto {
    /// Positions in the cube of the tables; true for those that have a density.
    fn in_cube(&self, positions: &[[f64; 3]]) -> (Vec<[f64; 3]>, Vec<bool>) {
        let within = positions.iter().map(|position| self.space.in_cube(*position));
        within.map(|found| (found.unwrap_or_default(), found.is_some())).unzip()
    }

    fn density(&self, exponential: f64) -> f64 {
        (self.mean_density * exponential).min(DENSEST)
    }

    /// Adds the density at each position of the world.
    pub(super) fn densities<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        densities: &mut Vec<f64>,
    ) {
        let first = densities.len();
        let (in_cube, has_density) = self.in_cube(positions);
        self.field.densities(&in_cube, scratch, densities);
        for (density, is_there) in densities.iter_mut().skip(first).zip(has_density) {
            *density = if is_there { self.density(*density) } else { 0.0 };
        }
    }

    /// The same for a proposal network.
    pub(super) fn proposed(
        &self,
        number: usize,
        positions: &[[f64; 3]],
        scratch: &mut Scratch<f64>,
        densities: &mut Vec<f64>,
    ) {
        let Some(network) = self.proposals.get(number) else { return };
        for packet in positions.chunks(LANES) {
            let (in_cube, has_density) = self.in_cube(packet);
            let outputs = network.run(&gathered(&in_cube), scratch);
            let raw = outputs.first().copied().unwrap_or_default();
            densities.extend(raw.into_iter().zip(has_density).map(|(raw, is_there)| {
                if is_there { self.density(raw.exponential()) } else { 0.0 }
            }));
        }
    }

    /// Evaluates up to [`LANES`] positions of the world. Returns their densities.
    pub(super) fn places<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        places: &mut Places<T>,
    ) -> Lanes<f64> {
        let (in_cube, has_density) = self.in_cube(positions);
        let mut densities = self.field.places(&in_cube, scratch, places);
        for (density, is_there) in densities.iter_mut().zip(has_density) {
            *density = if is_there { self.density(*density) } else { 0.0 };
        }
        densities
    }

    /// Unit directions, prepared.
    pub(super) fn along<T: Number>(&self, directions: &[[f64; 3]]) -> Directions<T> {
        let inputs: Vec<_> = directions.iter().map(|&direction| self.encoded(direction)).collect();
        self.field.color.directions(&inputs)
    }

    /// A direction as network input.
    fn encoded(&self, direction: [f64; 3]) -> [f64; FUNCTIONS] {
        match self.by_torch {
            // Directions are mapped to 0 to 1 for tiny-cuda-nn, which maps them back.
            true => moved_basis(direction.map(|along| 0.5 * (along + 1.0))),
            false => basis_f64(direction),
        }
    }
}

/// nerfstudio's own harmonics, with positive signs, of a vector of any length.
/// `components_from_spherical_harmonics` of nerfstudio 1.1.5.
#[rustfmt::skip]
fn moved_basis([x, y, z]: [f64; 3]) -> [f64; FUNCTIONS] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_791_773_878_14,
        0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        1.092_548_430_592_079_2 * y * z,
        0.946_174_695_757_560_1 * zz - 0.315_391_565_252_52,
        1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (xx - yy),
        0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        0.457_045_799_464_465_8 * y * (5.0 * zz - 1.0),
        0.373_176_332_590_115_4 * z * (5.0 * zz - 3.0),
        0.457_045_799_464_465_8 * x * (5.0 * zz - 1.0),
        1.445_305_721_320_277 * z * (xx - yy),
        0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}
