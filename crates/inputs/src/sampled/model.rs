//! A file of sampled arrays by its own rules: samples from the face of the box on, colours clamped
//! at each.

use super::keys::Arrays;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{DepthComposite, unit_direction};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::sparse::{ColoredRows, Lattice, LoadedRows};

/// Optical depth at which a ray ends: anything behind is invisible in 8 bits.
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
        let (stored, harmonics) = (self.stored, *harmonics);
        let colored = ColoredRows { rows, lattice, stored, harmonics };
        Ok(Box::new(Sampled { colored, step: self.step }))
    }
}

/// A file in memory.
#[derive(Debug)]
struct Sampled {
    colored: ColoredRows,
    step: f64,
}

impl TrainedModel for Sampled {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let colored = &self.colored;
        let functions = colored.functions(unit_direction(ray));
        let mut light = DepthComposite::default();
        if let Some(path) = colored.lattice.path(ray, rules) {
            path.walk(&colored.rows, self.step, progress, |t, cell| {
                let sigma = colored.rows.density(cell);
                if sigma > 0.0 {
                    light.add(self.step * sigma, t, colored.color(cell, &functions));
                }
                light.depth < OPAQUE_DEPTH
            });
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        self.colored.density(position).max(0.0) as f32
    }

    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        self.colored.colors(position, directions)
    }
}
