//! Plenoxels by the rules of svox2's renderer `cuvol`.
//!
//! ```text
//! g      = (x - center + radius) / (2 radius) N - 1/2     position in cells
//! step   = step_size cells along the ray, of world length step_size * delta
//! depth  = step length * sigma, for sigma > sigma_thresh
//! colour = max(0, sum of Y_b(d) k_b + 1/2)
//! ```

use super::arguments::RunArguments;
use super::keys::Arrays;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::input::sparse::LoadedRows;
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
        let files = match std::sync::Arc::ptr_eq(&arrays.density, &arrays.color) {
            true => vec![&*arrays.density],
            false => vec![&*arrays.density, &*arrays.color],
        };
        let mut budget = Budget::new(limits);
        let rows = LoadedRows::load(&arrays.index, &files, density, color, &mut budget)?;
        let (radius, center) = (arrays.radius, arrays.center);
        let stored = arrays.functions;
        let (run, harmonics) = (self.run.clone(), self.harmonics);
        Ok(Box::new(Plenoxels { rows, radius, center, stored, run, harmonics }))
    }
}

/// A model in memory.
#[derive(Debug)]
struct Plenoxels {
    rows: LoadedRows,
    radius: [f64; 3],
    center: [f64; 3],
    /// Coefficients of a colour in a row.
    stored: usize,
    run: RunArguments,
    harmonics: Harmonics,
}

/// A ray in cells.
struct Path {
    origin: [f64; 3],
    /// Of unit length in cells.
    direction: [f64; 3],
    /// World units for a cell along the ray.
    delta: f64,
    /// First sample and end, in cells along the ray.
    start: f64,
    end: f64,
}

impl Plenoxels {
    /// Cells along each axis, as numbers.
    fn counts(&self) -> [f64; 3] {
        self.rows.nodes().0.map(|count| count as f64)
    }

    /// A position in cells; 0 is the middle of the first one.
    fn to_cells(&self, world: [f64; 3]) -> [f64; 3] {
        let mut cells = self.counts();
        let axes = world.into_iter().zip(self.center).zip(self.radius);
        for (cell, ((world, center), radius)) in cells.iter_mut().zip(axes) {
            *cell = (world - center + radius) / (2.0 * radius) * *cell - 0.5;
        }
        cells
    }

    /// The nearest position that has nodes on all sides.
    fn clamped(&self, cells: [f64; 3]) -> [f64; 3] {
        let mut clamped = cells;
        clamped.iter_mut().zip(self.counts()).for_each(|(at, n)| *at = at.clamp(0.0, n - 1.0));
        clamped
    }

    /// The part of a ray in the box; none if it misses it.
    fn path(&self, ray: &Ray, rules: &RayRules) -> Option<Path> {
        let unit = (ray.direction / ray.direction.length()).to_array();
        let mut direction = self.counts();
        for (step, (unit, radius)) in direction.iter_mut().zip(unit.into_iter().zip(self.radius)) {
            *step = unit * *step / (2.0 * radius);
        }
        let delta = 1.0 / direction.iter().map(|step| step * step).sum::<f64>().sqrt();
        let direction = direction.map(|step| step * delta);
        let origin = self.to_cells(ray.origin.to_array());
        let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
        for ((from, by), count) in origin.into_iter().zip(direction).zip(self.counts()) {
            let faces = [-0.5, count - 0.5];
            if by == 0.0 {
                if !(-0.5..=count - 0.5).contains(&from) {
                    return None;
                }
                continue;
            }
            let [a, b] = faces.map(|face| (face - from) / by);
            (start, end) = (start.max(a.min(b)), end.min(a.max(b)));
        }
        let near = f64::from(rules.near).max(0.0) / delta;
        let far = rules.far.map_or(f64::INFINITY, |far| f64::from(far) / delta);
        start = start.max(near).min(far);
        (start <= end).then_some(Path { origin, direction, delta, start, end })
    }

    /// The colour in a cell along a direction of which the functions' values are known.
    fn color(&self, cell: &crate::input::sparse::Cell, functions: &[f64]) -> [f64; 3] {
        let sums = self.rows.color(cell, functions, self.stored);
        sums.map(|sum| (sum + f64::from(self.harmonics.offset)).max(0.0))
    }

    /// The functions that are used, in a unit direction.
    fn functions(&self, direction: [f64; 3]) -> Vec<f64> {
        basis_f64(direction).into_iter().take(self.harmonics.functions()).collect()
    }
}

impl Path {
    fn position(&self, t: f64) -> [f64; 3] {
        let mut position = self.origin;
        position.iter_mut().zip(self.direction).for_each(|(at, by)| *at += t * by);
        position
    }

    /// The length along the ray at which it leaves a box.
    fn leaves(&self, faces: [[f64; 2]; 3]) -> f64 {
        let axes = self.origin.into_iter().zip(self.direction).zip(faces);
        let exits = axes.map(|((from, by), [low, high])| match by {
            0.0 => f64::INFINITY,
            _ => ((low - from) / by).max((high - from) / by),
        });
        exits.fold(f64::INFINITY, f64::min)
    }
}

impl TrainedModel for Plenoxels {
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn ray_color(&self, ray: &Ray, rules: &RayRules) -> RayColor {
        let functions = self.functions((ray.direction / ray.direction.length()).to_array());
        let (mut depth, mut distance, mut color) = (0.0f64, 0.0, [0.0f64; 3]);
        if let Some(path) = self.path(ray, rules) {
            let step = self.run.step_size;
            let mut number = 0.0f64;
            loop {
                let t = path.start + number * step;
                if t > path.end {
                    break;
                }
                let at = self.clamped(path.position(t));
                if self.rows.is_empty(at) {
                    // Whole steps, so that samples keep their places.
                    let leaves = path.leaves(self.rows.cube_faces(at));
                    number = ((leaves - path.start) / step).floor().max(number + 1.0);
                    continue;
                }
                let cell = self.rows.cell(at);
                let sigma = self.rows.density(&cell);
                if sigma > self.run.sigma_thresh {
                    let is_last = self.run.last_sample_opaque && t + step > path.end;
                    let length = if is_last { OPAQUE_LENGTH } else { step * path.delta };
                    let weight = -libm::exp(-depth) * libm::expm1(-length * sigma);
                    let seen = self.color(&cell, &functions);
                    color.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += weight * seen);
                    distance += weight * t * path.delta;
                    depth += length * sigma;
                    if libm::exp(-depth) < self.run.stop_thresh {
                        depth = f64::INFINITY;
                        break;
                    }
                }
                number += 1.0;
            }
        }
        let left = libm::exp(-depth);
        let mut over = rules.background;
        over.iter_mut().zip(color).for_each(|(behind, sum)| {
            *behind = (sum + left * f64::from(*behind)) as f32;
        });
        let far = f64::from(rules.far.unwrap_or(0.0));
        let distance = (distance + left * far) as f32;
        RayColor { color: over, transmittance: left as f32, distance }
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let cells = self.to_cells(position);
        let inside = |(at, count): (&f64, f64)| (-0.5..=count - 0.5).contains(at);
        if !cells.iter().zip(self.counts()).all(inside) {
            return 0.0;
        }
        let sigma = self.rows.density(&self.rows.cell(self.clamped(cells)));
        if sigma > self.run.sigma_thresh { sigma as f32 } else { 0.0 }
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let cell = self.rows.cell(self.clamped(self.to_cells(position)));
        let colors = directions.iter().map(|&direction| {
            self.color(&cell, &self.functions(direction)).map(|value| value as f32)
        });
        colors.collect()
    }
}
