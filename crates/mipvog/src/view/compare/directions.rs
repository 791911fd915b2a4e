//! Compares visible colours along directions with those of the original model.
//!
//! Rays start at given eyes. Each sample is weighted by its share of the ray's light, so the errors
//! describe pictures, not the inside of walls.

use glam::DVec3;

use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::grid::Bounds;
use crate::model::harmonics::Clamp;
use crate::model::ray_march::{Next, Steps, ZeroGuard, crossing, point_at};
use crate::model::view_dependence::ViewDependence;
use crate::view::render::Renderer;

/// Total number of rays.
const RAYS: usize = 4096;
/// Number of rays per task of a thread.
const CHUNK: usize = 64;
/// Samples of less than this weight are ignored.
const LEAST_WEIGHT: f64 = 1e-3;
/// Transmittance at which a ray ends.
const OPAQUE: f64 = 1e-3;
/// The powers of this number give a low-discrepancy sequence in three dimensions.
const SPREAD: f64 = 1.220_744_084_605_759_5;

/// Errors of colours along directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionErrors {
    /// PSNR in dB of colours clamped to 0 to 1; infinite if they are equal. `None` if no ray met a
    /// visible sample.
    pub psnr: Option<f64>,
    /// Share of the samples' weight that has a channel clamped at 0. `None` if colours are not
    /// clamped this way, or if there is no sample.
    pub clamped_share: Option<f64>,
}

/// Sums over samples.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    weight: f64,
    squares: f64,
    clamped: f64,
}

/// Compares the colours of `baked`, at level 0 and along rays from `eyes`, with those of
/// `reference` at the same points. [`Step::Render`] advances by rays.
///
/// # Errors
///
/// As [`Renderer::sample`], and `Cancelled`.
pub fn compare_directions(
    reference: &Renderer,
    baked: &Renderer,
    eyes: &[[f64; 3]],
    progress: &dyn Progress,
) -> Result<DirectionErrors> {
    progress.begin(Step::Render, RAYS as u64);
    let sums = parallel::map(RAYS.div_ceil(CHUNK), |chunk| {
        let mut sums = Sums::default();
        for number in chunk * CHUNK..((chunk + 1) * CHUNK).min(RAYS) {
            if let Some(eye) = eyes.get(number % eyes.len().max(1)) {
                follow(reference, baked, *eye, number, &mut sums, progress)?;
            }
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
        }
        progress.advance(Step::Render, CHUNK as u64);
        Ok(sums)
    })?;
    let sums = sums.into_iter().fold(Sums::default(), |all, part| Sums {
        weight: all.weight + part.weight,
        squares: all.squares + part.squares,
        clamped: all.clamped + part.clamped,
    });
    let share = |sum: f64| (sums.weight > 0.0).then(|| sum / sums.weight);
    let rules = baked.view().view_dependence.as_ref().and_then(ViewDependence::harmonics);
    let is_clamped = rules.is_some_and(|rules| rules.clamp == Clamp::Zero);
    Ok(DirectionErrors {
        psnr: share(sums.squares / 3.0).map(|square| -10.0 * libm::log10(square)),
        clamped_share: share(sums.clamped).filter(|_| is_clamped),
    })
}

/// Adds the samples of a ray from `eye` through one point of the box.
fn follow(
    reference: &Renderer,
    baked: &Renderer,
    eye: [f64; 3],
    number: usize,
    sums: &mut Sums,
    progress: &dyn Progress,
) -> Result<()> {
    let view = baked.view();
    // The innermost of nested boxes, the only one that level 0 shows.
    let Bounds { min, max } = view.finest_bounds;
    let [min, max] = [min, max].map(|corner| DVec3::from(corner.map(f64::from)));
    let share = [1, 2, 3].map(|power| (0.5 + number as f64 * SPREAD.powi(-power)).fract());
    let eye = DVec3::from(eye);
    // An eye at the point itself has no direction.
    let to_point = min + (max - min) * DVec3::from(share) - eye;
    let Some(direction) = to_point.try_normalize() else { return Ok(()) };
    let (origin, along) = (eye.to_array(), direction.to_array());
    let corners = [min.to_array(), max.to_array()];
    let guard = ZeroGuard::Replace(f64::MIN_POSITIVE);
    let [enters, leaves] = crossing(origin, along, corners, guard);
    let step = view.march.interval_length();
    let mut transmittance = 1.0;
    let mut sampled = Ok(());
    let steps = Steps { start: enters.max(0.0), step, end: leaves };
    steps.walk(0.0, progress, |t| {
        let at = point_at(origin, along, t);
        let weight = baked.sample(at, 0).map(|sample| {
            let weight = -transmittance * libm::expm1(-f64::from(sample.density) * step);
            transmittance -= weight;
            weight
        });
        sampled = weight.and_then(|weight| match weight < LEAST_WEIGHT {
            true => Ok(()),
            false => sums.add(weight, reference, baked, at, along),
        });
        if sampled.is_ok() && transmittance > OPAQUE { Next::Step } else { Next::End }
    });
    sampled
}

impl Sums {
    /// Adds the colours of a sample.
    fn add(
        &mut self,
        weight: f64,
        reference: &Renderer,
        baked: &Renderer,
        at: [f64; 3],
        along: [f64; 3],
    ) -> Result<()> {
        let shown = baked.point_colors(at, &[along], 0)?;
        let expected = reference.point_colors(at, &[along], 0)?;
        self.weight += weight;
        for (shown, expected) in shown.as_flattened().iter().zip(expected.as_flattened()) {
            let off = f64::from(shown.clamp(0.0, 1.0)) - f64::from(expected.clamp(0.0, 1.0));
            self.squares += weight * off * off;
        }
        if shown.as_flattened().contains(&0.0) {
            self.clamped += weight;
        }
        Ok(())
    }
}
