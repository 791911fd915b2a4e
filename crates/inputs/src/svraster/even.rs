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
//! logits. Voxels smaller than the cells of a box are averaged with their own densities: corrected
//! ones were up to 0.5 dB worse, because averages let more light pass already.

use std::sync::Arc;

use super::density::{EvenDensities, between, density};
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
    /// Densities for a field.
    pub(super) fn even(&self) -> Result<Arc<EvenDensities>> {
        let voxels = self.load()?;
        let unit = unit(self.settings.extent);
        self.even.get(|| {
            let cubes = self.places.cubes();
            let [smallest, largest] = self.cells;
            let used = used(&voxels, &cubes, smallest);
            let logits = logits(&voxels, &cubes, &used, unit, self.samples)?;
            let means = match cubes.iter().any(|cube| cube.edge < largest) {
                true => means(&voxels, &cubes, largest)?,
                false => Vec::new(),
            };
            Ok(EvenDensities { logits, means })
        })
    }
}

/// The distinct corners of voxels that give nodes their densities: those at least as large as a
/// cell.
fn used(voxels: &Voxels, cubes: &[Cube], cell: u32) -> Vec<bool> {
    let mut used = vec![false; voxels.table().len()];
    for (voxel, _) in (0..).zip(cubes).filter(|(_, cube)| cube.edge >= cell) {
        for corner in voxels.numbers(voxel) {
            used.get_mut(corner as usize).into_iter().for_each(|used| *used = true);
        }
    }
    used
}

/// Mean optical depths per world unit of voxels smaller than a cell.
fn means(voxels: &Voxels, cubes: &[Cube], cell: u32) -> Result<Vec<f32>> {
    let parts = parallel::map(cubes.len().div_ceil(CHUNK), |part| {
        let start = part * CHUNK;
        let own = cubes.get(start..cubes.len().min(start + CHUNK)).unwrap_or_default();
        let mean = |(at, cube): (usize, &Cube)| match cube.edge < cell {
            true => mean_density(&voxels.corners(u32::try_from(at).unwrap_or(u32::MAX))),
            false => 0.0,
        };
        Ok((start..).zip(own).map(mean).collect::<Vec<f32>>())
    })?;
    Ok(parts.concat())
}

/// The mean optical depth per world unit between raw densities at corners.
#[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
fn mean_density(corners: &[f32; 8]) -> f32 {
    let mut sum = 0.0;
    for x in PAIR {
        for y in PAIR {
            for z in PAIR {
                sum += density(between(corners, [x, y, z]));
            }
        }
    }
    (sum / 8.0) as f32
}

/// Logits of the densities at distinct corners, corrected at those that are used. Voxels have this
/// many `samples` by their own rules.
fn logits(
    voxels: &Voxels,
    cubes: &[Cube],
    used: &[bool],
    unit: f64,
    samples: u32,
) -> Result<Vec<f32>> {
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
                let is_used = |corner: u32| used.get(corner as usize).copied().unwrap_or(false);
                if !voxels.numbers(voxel).into_iter().any(is_used) {
                    return Sums::default();
                }
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
