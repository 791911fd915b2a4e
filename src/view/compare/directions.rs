//! Visible colours along directions, against those of the model that they were made of.
//!
//! Rays start at given eyes. A sample counts by its share of its ray's light, so the figures are
//! of what pictures show, and not of the inside of walls.

use glam::DVec3;

use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::harmonics::Clamp;
use crate::model::trained_model::Samples;
use crate::model::view_dependence::ViewDependence;
use crate::view::render::Renderer;

/// Rays in all.
const RAYS: usize = 4096;
/// Rays that a thread takes at once.
const CHUNK: usize = 64;
/// Samples of a smaller weight are left out.
const LEAST_WEIGHT: f64 = 1e-3;
/// Transmittance at which a ray ends.
const OPAQUE: f64 = 1e-3;
/// Powers of this number are spread evenly in three dimensions.
const SPREAD: f64 = 1.220_744_084_605_759_5;

/// Colours along directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionErrors {
    /// PSNR of colours, limited to 0 to 1, in dB; without a bound where they are equal. `None` where
    /// no ray met a visible sample.
    pub psnr: Option<f64>,
    /// Share of the samples' weight with a channel that is limited at 0. `None` where colours are
    /// not limited so, or without samples.
    pub clamped_share: Option<f64>,
}

/// Sums over samples.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    weight: f64,
    squares: f64,
    clamped: f64,
}

/// Compares the colours of `baked`, at level 0 and along rays from `eyes`, with those of `reference`
/// at the same points. [`Step::Render`] advances by rays.
///
/// # Errors
///
/// Those of [`Renderer::sample`], and a request to stop.
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
    let [min, max] =
        [view.bounds.min, view.bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let share = [1, 2, 3].map(|power| (0.5 + number as f64 * SPREAD.powi(-power)).fract());
    let eye = DVec3::from(eye);
    // An eye at that very point looks nowhere.
    let to_point = min + (max - min) * DVec3::from(share) - eye;
    let Some(direction) = to_point.try_normalize() else { return Ok(()) };
    let (a, b) = ((min - eye) / direction, (max - eye) / direction);
    let [enters, leaves] = [a.min(b).max_element().max(0.0), a.max(b).min_element()];
    let step = view.march.interval_length();
    let (mut passes, mut steps) = (1.0, 0.0);
    let mut samples = Samples::new(enters, step, progress);
    while passes > OPAQUE && enters + steps * step <= leaves && samples.take() {
        let at = (eye + direction * (enters + steps * step)).to_array();
        steps += 1.0;
        let depth = f64::from(baked.sample(at, 0)?.density) * step;
        let weight = -passes * libm::expm1(-depth);
        passes -= weight;
        if weight < LEAST_WEIGHT {
            continue;
        }
        let along = [direction.to_array()];
        let shown = baked.point_colors(at, &along, 0)?;
        let expected = reference.point_colors(at, &along, 0)?;
        sums.weight += weight;
        for (shown, expected) in shown.as_flattened().iter().zip(expected.as_flattened()) {
            let off = f64::from(shown.clamp(0.0, 1.0)) - f64::from(expected.clamp(0.0, 1.0));
            sums.squares += weight * off * off;
        }
        if shown.as_flattened().contains(&0.0) {
            sums.clamped += weight;
        }
    }
    Ok(())
}
