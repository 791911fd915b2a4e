//! Splats at the points of a lattice.

use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::activate::lanes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, basis};
use crate::view::Lattice;
use crate::view::render::Renderer;

/// Opacity over the distance of two points from which there is a splat.
const SHOWS: f32 = 0.01;
/// A point is hidden where all its neighbours are more opaque than this.
const HIDES: f32 = 0.9;
/// The standard deviation of a splat, in distances of points.
const SPREAD: f32 = 0.5;
/// Opacities of splats begin within these.
const OPACITIES: [f32; 2] = [0.02, 0.98];
/// Directions that colours are taken in.
const DIRECTIONS: usize = 64;

/// Splats at all points that show something.
///
/// # Errors
/// More memory than the limits allow, and a request to stop.
pub(super) fn splats(
    field: &Renderer,
    lattice: &Lattice,
    level: usize,
    limits: &Limits,
    progress: &dyn Progress,
) -> Result<Vec<GaussianSplat>> {
    let [nx, ny, nz] = lattice.counts();
    let values =
        limits::product(&[nx as u64, ny as u64, nz as u64, 4], "bytes of densities", &Place::File)?;
    limits::check(
        LimitName::Memory,
        "bytes of densities",
        values as u64,
        limits.memory,
        &Place::File,
    )?;
    let spacing = lattice.spacing.iter().product::<f64>();
    #[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
    let edge = libm::cbrt(spacing) as f32;
    progress.begin(Step::Encode, 2 * nx as u64);
    let planes = parallel::map(nx, |x| {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let mut plane = Vec::with_capacity(ny * nz);
        for (y, z) in (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))) {
            let density = field.density_at(lattice.share([x, y, z]), level);
            plane.push(lanes::opacity(density * edge));
        }
        progress.advance(Step::Encode, 1);
        Ok(plane)
    })?;
    let opacity = |[x, y, z]: [usize; 3]| planes[x][y * nz + z];
    let shows = |at: [usize; 3]| {
        let counts = [nx, ny, nz];
        opacity(at) >= SHOWS
            && (0..3).any(|axis| {
                let mut near = [at, at];
                near[0][axis] = at[axis].saturating_sub(1);
                near[1][axis] = (at[axis] + 1).min(counts[axis] - 1);
                at[axis] == 0
                    || at[axis] + 1 == counts[axis]
                    || near.map(opacity).iter().any(|v| *v < HIDES)
            })
    };
    let directions = directions();
    let weights = directions.map(basis);
    let found = parallel::map(nx, |x| {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let mut splats = Vec::new();
        for (y, z) in (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))) {
            let at = [x, y, z];
            if shows(at) {
                let world = lattice.world(at);
                let colors = field.point_colors(world, &directions, level)?;
                splats.push(splat(world, edge, opacity(at), &colors, &weights));
            }
        }
        progress.advance(Step::Encode, 1);
        Ok(splats)
    })?;
    let count: usize = found.iter().map(Vec::len).sum();
    if count == 0 {
        return Err(Error::usage("the field shows nothing, so there is nothing to make splats of"));
    }
    // Each with what an optimizer remembers of it.
    let bytes = 4 * (count * size_of::<GaussianSplat>()) as u64;
    limits::check(LimitName::Memory, "bytes of splats", bytes, limits.memory, &Place::File)?;
    Ok(found.concat())
}

/// Directions from all around, evenly spread.
fn directions() -> [[f64; 3]; DIRECTIONS] {
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    std::array::from_fn(|number| {
        let z = 1.0 - (2 * number + 1) as f64 / DIRECTIONS as f64;
        let around = (1.0 - z * z).sqrt();
        let angle = turn * number as f64;
        [around * libm::cos(angle), around * libm::sin(angle), z]
    })
}

#[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
fn splat(
    world: [f64; 3],
    edge: f32,
    opacity: f32,
    colors: &[[f32; 3]],
    weights: &[[f32; FUNCTIONS]],
) -> GaussianSplat {
    let mut out = [0.0; PARAMETERS];
    out.iter_mut().zip(world).for_each(|(out, at)| *out = at as f32);
    out[SIZE] = lanes::ln(f64::from(SPREAD * edge)) as f32;
    let opacity = f64::from(opacity.clamp(OPACITIES[0], OPACITIES[1]));
    out[OPACITY] = libm::log(opacity / (1.0 - opacity)) as f32;
    // The functions are orthonormal over the sphere: sums over directions are the fit.
    let share = 4.0 * std::f32::consts::PI / colors.len() as f32;
    for (color, weights) in colors.iter().zip(weights) {
        for (function, weight) in weights.iter().enumerate() {
            for (channel, value) in color.iter().enumerate() {
                out[COLOR + 3 * function + channel] += share * weight * value.clamp(0.0, 1.0);
            }
        }
    }
    for channel in &mut out[COLOR..COLOR + 3] {
        *channel -= 0.5 / BAND_0;
    }
    out
}
