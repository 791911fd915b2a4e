//! A file of the open door by its own rules: samples from the face of the box on, colours clamped
//! at each.

use super::keys::Arrays;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::input::sparse::{Cell, Lattice, Light, LoadedRows};
use crate::model::activate;
use crate::model::camera::Ray;
use crate::model::harmonics::{Clamp, Harmonics, basis_f64};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// Optical depth from which a ray ends: no 8-bit picture shows what is behind.
const OPAQUE_DEPTH: f64 = 20.0;

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct SampledFile {
    pub(super) arrays: Arrays,
    /// Coefficients of a colour in a row.
    pub(super) stored: usize,
    /// Distance of samples in world units.
    pub(super) step: f64,
}

impl LoadModel for SampledFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let Arrays { index, density, color, harmonics, bounds } = &self.arrays;
        let rows = LoadedRows::load(index, &[density, color], 0, 0, &mut Budget::new(limits))?;
        let nodes = index.nodes();
        let lattice = Lattice {
            origin: bounds.min.map(f64::from),
            per_unit: nodes.spacing(bounds).map(|spacing| 1.0 / spacing),
            faces: nodes.0.map(|count| [0.0, (count - 1) as f64]),
        };
        let (stored, step) = (self.stored, self.step);
        Ok(Box::new(Sampled { rows, lattice, harmonics: *harmonics, stored, step }))
    }
}

/// A file in memory.
#[derive(Debug)]
struct Sampled {
    rows: LoadedRows,
    /// Positions in nodes.
    lattice: Lattice,
    /// None for plain colours.
    harmonics: Option<Harmonics>,
    stored: usize,
    step: f64,
}

impl Sampled {
    fn color(&self, cell: &Cell, functions: &[f64]) -> [f64; 3] {
        let sums = self.rows.color(cell, functions, self.stored);
        let Some(rules) = &self.harmonics else { return sums };
        let sums = sums.map(|sum| sum + f64::from(rules.offset));
        match rules.clamp {
            Clamp::Zero => sums.map(|sum| sum.max(0.0)),
            Clamp::None => sums,
            Clamp::Sigmoid => sums.map(activate::sigmoid),
        }
    }

    /// The functions that are used, in a unit direction; of plain colours, the colour itself.
    fn functions(&self, direction: [f64; 3]) -> Vec<f64> {
        match &self.harmonics {
            Some(rules) => basis_f64(direction).into_iter().take(rules.functions()).collect(),
            None => vec![1.0],
        }
    }
}

impl TrainedModel for Sampled {
    fn ray_color(&self, ray: &Ray, rules: &RayRules) -> RayColor {
        let functions = self.functions((ray.direction / ray.direction.length()).to_array());
        let mut light = Light::default();
        if let Some(path) = self.lattice.path(ray, rules) {
            path.walk(&self.rows, self.step, |t, cell| {
                let sigma = self.rows.density(cell);
                if sigma > 0.0 {
                    light.add(self.step * sigma, t, self.color(cell, &functions));
                }
                light.depth < OPAQUE_DEPTH
            });
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let at = self.lattice.to_nodes(position);
        if !self.lattice.contains(at) {
            return 0.0;
        }
        self.rows.density(&self.rows.cell(self.rows.clamped(at))).max(0.0) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let cell = self.rows.cell(self.rows.clamped(self.lattice.to_nodes(position)));
        let colors = directions.iter().map(|&direction| {
            self.color(&cell, &self.functions(direction)).map(|value| value as f32)
        });
        colors.collect()
    }
}
