//! Densities for many short steps that match the look of a voxel with few samples.
//!
//! SVRaster samples a voxel in the middle of its chord. Densities grow exponentially towards a
//! surface, so the middle has less than the mean. A field is marched with steps shorter than
//! voxels, so the file's own densities would be too high. The densities at corners are therefore
//! corrected once, from rays through the voxels around a corner; more passes were no better:
//!
//! ```text
//! density of a corner *= sum over rays of w (1 - exp(-depth by few samples))
//!                      / sum over rays of w (1 - exp(-depth by many steps))
//! ```
//!
//! Each voxel has twelve rays: along each axis, through two places along each other axis. `w` is
//! the proximity of a ray to the corner. Densities are logits here, because a field interpolates
//! logits.

use std::sync::Arc;

use super::density::{between, density};
use super::loaded::{VoxelFile, Voxels};
use super::octree::{Cube, unit};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate;

/// Optical depth per world unit of a softplus of 1. The file's densities are exponential up to 110,
/// then linear; with this value, a softplus bends most similarly.
pub(super) const SCALE: f64 = 250.0;
/// Number of steps of a voxel that approximates many.
const STEPS: u32 = 4;
/// Positions of two samples, as shares of an edge.
const PAIR: [f64; 2] = [0.211_324_865_405_187, 0.788_675_134_594_813];
/// Voxels per thread and batch, and the number of batches in memory.
const CHUNK: usize = 1 << 14;
const CHUNKS: usize = 16;

/// The logit of an optical depth per world unit.
#[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
pub(super) fn logit(density: f64) -> f32 {
    activate::inverse_softplus(density / SCALE) as f32
}

/// The optical depth per world unit of a logit.
fn of_logit(logit: f64) -> f64 {
    SCALE * activate::softplus(logit)
}

/// Sums of a voxel's rays at its corners: by few samples, and by many steps.
type Sums = [[f32; 2]; 8];

impl VoxelFile {
    /// Logits of densities at distinct corners, for a field.
    pub(super) fn logits(&self) -> Result<Arc<Vec<f32>>> {
        let voxels = self.load()?;
        let unit = unit(self.settings.extent);
        self.logits.get(|| logits(&voxels, &self.places.cubes(), unit, self.samples))
    }
}

/// Logits of the densities at distinct corners. Voxels have this many `samples` by their own rules.
fn logits(voxels: &Voxels, cubes: &[Cube], unit: f64, samples: u32) -> Result<Vec<f32>> {
    let mut logits: Vec<f32> =
        voxels.table().iter().map(|raw| logit(density(f64::from(*raw)))).collect();
    let mut sums = vec![[0.0f32; 2]; logits.len()];
    for first in (0..cubes.len()).step_by(CHUNK * CHUNKS) {
        let end = (first + CHUNK * CHUNKS).min(cubes.len());
        let found = parallel::map((end - first).div_ceil(CHUNK), |part| {
            let start = first + part * CHUNK;
            let of_voxel = |at: usize| {
                let edge = cubes.get(at).map_or(0, |cube| cube.edge);
                let voxel = u32::try_from(at).unwrap_or(u32::MAX);
                let own = voxels.at_corners(&logits, voxel);
                of_voxel(&voxels.corners(voxel), &own, f64::from(edge) * unit, samples)
            };
            Ok((start..end.min(start + CHUNK)).map(of_voxel).collect::<Vec<Sums>>())
        })?;
        for (voxel, own) in (first..).zip(found.into_iter().flatten()) {
            let corners = voxels.numbers(u32::try_from(voxel).unwrap_or(u32::MAX));
            for (corner, [few, many]) in corners.into_iter().zip(own) {
                if let Some([of_few, of_many]) = sums.get_mut(corner as usize) {
                    (*of_few, *of_many) = (*of_few + few, *of_many + many);
                }
            }
        }
    }
    for (own, [few, many]) in logits.iter_mut().zip(sums) {
        if few > 0.0 && many > 0.0 {
            *own = logit(of_logit((*own).into()) * f64::from(few) / f64::from(many));
        }
    }
    Ok(logits)
}

#[expect(clippy::cast_possible_truncation, reason = "ratios of sums are float32")]
fn of_voxel(raw: &[f32; 8], logits: &[f32; 8], length: f64, samples: u32) -> Sums {
    let mut sums = [[0.0; 2]; 8];
    for axis in 0..3 {
        for a in PAIR {
            for b in PAIR {
                let at = |along: f64| match axis {
                    0 => [along, a, b],
                    1 => [a, along, b],
                    _ => [a, b, along],
                };
                let few = mean(samples, |along| density(between(raw, at(along))));
                let many = mean(STEPS, |along| of_logit(between(logits, at(along))));
                let stopped = [few, many].map(|density| -libm::expm1(-density * length));
                for (number, sums) in sums.iter_mut().enumerate() {
                    let near = |share: f64, bit: usize| match number >> bit & 1 {
                        1 => share,
                        _ => 1.0 - share,
                    };
                    let weight = match axis {
                        0 => near(a, 1) * near(b, 0),
                        1 => near(a, 2) * near(b, 0),
                        _ => near(a, 2) * near(b, 1),
                    };
                    let terms = sums.iter_mut().zip(stopped);
                    terms.for_each(|(sum, stopped)| *sum += (weight * stopped) as f32);
                }
            }
        }
    }
    sums
}

/// The mean of values in the middle of equal parts of an edge.
fn mean(count: u32, value: impl Fn(f64) -> f64) -> f64 {
    let places = (0..count).map(|part| (f64::from(part) + 0.5) / f64::from(count));
    places.map(value).sum::<f64>() / f64::from(count)
}
