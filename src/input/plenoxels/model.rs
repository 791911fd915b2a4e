//! Plenoxels by the rules of svox2's renderer `cuvol`.
//!
//! ```text
//! g      = (x - center + radius) / (2 radius) N - 1/2     position in cells
//! step   = step_size cells along the ray, of world length step_size * delta
//! depth  = step length * sigma, for sigma > sigma_thresh
//! colour = max(0, sum of Y_b(d) k_b + 1/2)
//! ```

use std::sync::Arc;

use super::arguments::RunArguments;
use super::arrays::Arrays;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::input::sparse::{Cell, Lattice, Light, LoadedRows};
use crate::model::camera::Ray;
use crate::model::harmonics::{Harmonics, basis_f64};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// The length of a last sample that hides all behind it.
const OPAQUE_LENGTH: f64 = 1e9;

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct PlenoxelsFile {
    pub(super) arrays: Arrays,
    pub(super) run: RunArguments,
    pub(super) harmonics: Harmonics,
}

impl LoadModel for PlenoxelsFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let arrays = &self.arrays;
        let [density, color] = arrays.columns;
        let files = match Arc::ptr_eq(&arrays.density, &arrays.color) {
            true => vec![&*arrays.density],
            false => vec![&*arrays.density, &*arrays.color],
        };
        let mut budget = Budget::new(limits);
        let rows = LoadedRows::load(&arrays.index, &files, density, color, &mut budget)?;
        let (lattice, stored) = (arrays.cells.lattice(), arrays.functions);
        let (run, harmonics) = (self.run.clone(), self.harmonics);
        Ok(Box::new(Plenoxels { rows, lattice, stored, run, harmonics }))
    }
}

/// A model in memory.
#[derive(Debug)]
struct Plenoxels {
    rows: LoadedRows,
    /// Positions in cells.
    lattice: Lattice,
    /// Coefficients of a colour in a row.
    stored: usize,
    run: RunArguments,
    harmonics: Harmonics,
}

impl Plenoxels {
    /// The colour in a cell along a direction of which the functions' values are known.
    fn color(&self, cell: &Cell, functions: &[f64]) -> [f64; 3] {
        let sums = self.rows.color(cell, functions, self.stored);
        sums.map(|sum| (sum + f64::from(self.harmonics.offset)).max(0.0))
    }

    /// The functions that are used, in a unit direction.
    fn functions(&self, direction: [f64; 3]) -> Vec<f64> {
        basis_f64(direction).into_iter().take(self.harmonics.functions()).collect()
    }
}

impl TrainedModel for Plenoxels {
    fn ray_color(&self, ray: &Ray, rules: &RayRules) -> RayColor {
        let functions = self.functions((ray.direction / ray.direction.length()).to_array());
        let mut light = Light::default();
        if let Some(path) = self.lattice.path(ray, rules) {
            // World units for a cell along the ray.
            let cell_length = 1.0 / path.direction.iter().map(|by| by * by).sum::<f64>().sqrt();
            let step = self.run.step_size * cell_length;
            path.walk(&self.rows, step, |t, cell| {
                let sigma = self.rows.density(cell);
                if sigma > self.run.sigma_thresh {
                    let is_opaque = self.run.last_sample_opaque && path.is_last(t, step);
                    let length = if is_opaque { OPAQUE_LENGTH } else { step };
                    light.add(length * sigma, t, self.color(cell, &functions));
                    if light.transmittance() < self.run.stop_thresh {
                        light.depth = f64::INFINITY;
                        return false;
                    }
                }
                true
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
        let sigma = self.rows.density(&self.rows.cell(self.rows.clamped(at)));
        if sigma > self.run.sigma_thresh { sigma as f32 } else { 0.0 }
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
