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
use super::background::add_spheres;
use super::spheres::{SphereFile, SpherePoint, SphereSpace, Spheres, Viewers};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::harmonics::Harmonics;
use crate::model::ray_march::{DepthComposite, unit_direction};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::sparse::ColoredRows;

/// The length of a last sample that hides all behind it.
const OPAQUE_LENGTH: f64 = 1e9;

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct PlenoxelsFile {
    pub(super) arrays: Arrays,
    pub(super) run: RunArguments,
    pub(super) harmonics: Harmonics,
    /// Behind the box.
    pub(super) spheres: Option<(Arc<SphereFile>, SphereSpace)>,
}

impl LoadModel for PlenoxelsFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let arrays = &self.arrays;
        let rows = arrays.load(limits)?;
        let (lattice, stored) = (arrays.cells.lattice(), arrays.functions);
        let colored = ColoredRows { rows, lattice, stored, harmonics: Some(self.harmonics) };
        let spheres = match &self.spheres {
            Some((file, space)) => Some((file.load()?, *space)),
            None => None,
        };
        Ok(Box::new(Plenoxels { colored, spheres, run: self.run.clone() }))
    }
}

/// A model in memory.
#[derive(Debug)]
struct Plenoxels {
    /// Rows at the centres of cells.
    colored: ColoredRows,
    spheres: Option<(Arc<Spheres>, SphereSpace)>,
    run: RunArguments,
}

impl TrainedModel for Plenoxels {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let colored = &self.colored;
        let functions = colored.functions(unit_direction(ray));
        let mut light = DepthComposite::default();
        if let Some(path) = colored.lattice.path(ray, rules) {
            // World units for a cell along the ray.
            let cell_length = 1.0 / path.direction.iter().map(|by| by * by).sum::<f64>().sqrt();
            let step = self.run.step_size * cell_length;
            path.walk(&colored.rows, step, progress, |t, cell| {
                let sigma = colored.rows.density(cell);
                if sigma > self.run.sigma_thresh {
                    let is_opaque = self.run.last_sample_opaque && path.is_last(t, step);
                    let length = if is_opaque { OPAQUE_LENGTH } else { step };
                    light.add(length * sigma, t, colored.color(cell, &functions));
                    if light.transmittance() < self.run.stop_thresh {
                        light.depth = f64::INFINITY;
                        return false;
                    }
                }
                true
            });
        }
        if let Some((spheres, space)) = &self.spheres
            && light.depth.is_finite()
        {
            let rules = [self.run.step_size, self.run.stop_thresh];
            add_spheres(&mut light, ray, (spheres, space), rules, progress);
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        (self.own_density(position) + self.behind(position).density) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let mut colors = self.colored.colors(position, directions);
        let behind = self.behind(position);
        if behind.density > 0.0 {
            let share = behind.density / (self.own_density(position) + behind.density);
            for color in &mut colors {
                for (own, behind) in color.iter_mut().zip(behind.color()) {
                    *own += (share * (behind - f64::from(*own))) as f32;
                }
            }
        }
        colors
    }
}

impl Plenoxels {
    /// Density of the box, per world unit.
    fn own_density(&self, position: [f64; 3]) -> f64 {
        let sigma = self.colored.density(position);
        if sigma > self.run.sigma_thresh { sigma } else { 0.0 }
    }

    /// The spheres at a position, seen from their middle.
    fn behind(&self, position: [f64; 3]) -> SpherePoint {
        let Some((spheres, space)) = &self.spheres else { return SpherePoint::default() };
        spheres.seen_at(space, position, &Viewers::default(), self.run.step_size).1
    }
}
