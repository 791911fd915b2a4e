//! A model by the rules of nerfstudio's renderer at evaluation.
//!
//! ```text
//! s(t)   = t / 2 below 1, else 1 - 1 / (2 t);  even samples:  s(t) = t
//! round 0: even ends in s, from near to far;  each next round: ends by the weights of the last one
//! t      = the middle of an interval
//! weight = exp(-sum of depths before) (1 - exp(-own depth)),  depth = density * length
//! colour = sum of weight * colour + (1 - sum of weights) * background, from 0 to 1
//! ```
//!
//! All rounds but the last one ask the networks of proposals for densities.

use std::sync::Arc;

use super::file::{Nerfacto, NerfactoFile};
use super::settings::{Background, Settings};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{over_background, point_at, ray_color, unit_direction};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::network::{Colors, all_around};
use crate::packets::{FieldScratch, LANES, Places, Scratch};
use crate::resample::resampled;

/// Minimum share of each ray's light that counts as left, for the colour behind a scene.
const LEAST_LEFT: f64 = 1e-6;

/// A checkpoint, ready to be loaded.
#[derive(Debug)]
pub(super) struct Unloaded(pub(super) Arc<NerfactoFile>);

impl LoadModel for Unloaded {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Loaded { file: Arc::clone(&self.0), model: self.0.load()? }))
    }
}

#[derive(Debug)]
struct Loaded {
    file: Arc<NerfactoFile>,
    model: Arc<Nerfacto>,
}

/// The mapping in which even samples are evenly spaced.
#[derive(Debug, Clone, Copy)]
struct Spacing {
    piecewise: bool,
    /// Of the nearest and the farthest distance.
    ends: [f64; 2],
}

impl Spacing {
    fn new(piecewise: bool, [near, far]: [f64; 2]) -> Self {
        let of = |t: f64| match piecewise {
            true if t < 1.0 => 0.5 * t,
            true => 1.0 - 0.5 / t,
            false => t,
        };
        Self { piecewise, ends: [of(near), of(far)] }
    }

    /// The distance at a share of the way.
    fn distance(self, share: f64) -> f64 {
        let [near, far] = self.ends;
        let at = share * far + (1.0 - share) * near;
        match self.piecewise {
            true if at < 0.5 => 2.0 * at,
            true => 1.0 / (2.0 - 2.0 * at),
            false => at,
        }
    }
}

/// The intervals of a round.
struct Intervals {
    /// Distances of their middles.
    middles: Vec<f64>,
    lengths: Vec<f64>,
    positions: Vec<[f64; 3]>,
}

impl Intervals {
    /// Between ends that are shares of a way.
    fn new(shares: &[f64], spacing: Spacing, origin: [f64; 3], direction: [f64; 3]) -> Self {
        let distances: Vec<f64> = shares.iter().map(|share| spacing.distance(*share)).collect();
        let pairs = || distances.iter().zip(distances.iter().skip(1));
        let middles: Vec<f64> = pairs().map(|(from, to)| 0.5 * (from + to)).collect();
        let lengths = pairs().map(|(from, to)| to - from).collect();
        let positions = middles.iter().map(|t| point_at(origin, direction, *t)).collect();
        Self { middles, lengths, positions }
    }

    /// The weights of the intervals.
    fn weights(&self, densities: &[f64]) -> Vec<f64> {
        let mut depth = 0.0;
        let all = self.lengths.iter().zip(densities);
        all.map(|(length, density)| {
            let own = length * density;
            let weight = -libm::expm1(-own) * libm::exp(-depth);
            depth += own;
            if weight.is_nan() { 0.0 } else { weight }
        })
        .collect()
    }
}

impl Loaded {
    /// The intervals of the last round along a ray.
    fn intervals(&self, spacing: Spacing, origin: [f64; 3], direction: [f64; 3]) -> Intervals {
        let Settings { samples, same_proposal, .. } = &self.file.settings;
        let first = samples.first().copied().unwrap_or(1);
        let mut shares: Vec<f64> = (0..=first).map(|number| number as f64 / first as f64).collect();
        let (mut scratch, mut densities) = (Scratch::default(), Vec::new());
        for (round, next) in samples.iter().skip(1).enumerate() {
            let intervals = Intervals::new(&shares, spacing, origin, direction);
            let number = if *same_proposal { 0 } else { round };
            densities.clear();
            self.model.proposed(number, &intervals.positions, &mut scratch, &mut densities);
            shares = resampled(&shares, &intervals.weights(&densities), *next);
        }
        Intervals::new(&shares, spacing, origin, direction)
    }
}

/// The light of a ray without what lies behind.
struct Light {
    sums: [f64; 3],
    /// The share of light that is left.
    left: f64,
    distance: f64,
    /// Colour of the last sample.
    last: [f64; 3],
}

impl Loaded {
    fn light(&self, origin: [f64; 3], direction: [f64; 3], near: f64) -> Light {
        let Settings { piecewise, far, .. } = self.file.settings;
        let spacing = Spacing::new(piecewise, [near.min(far), far]);
        let intervals = self.intervals(spacing, origin, direction);
        let along = self.model.along::<f64>(&[direction]);
        let (mut scratch, mut places) = (FieldScratch::default(), Places::default());
        let (mut densities, mut colors) = (Vec::new(), Vec::new());
        for packet in intervals.positions.chunks(LANES) {
            let found = self.model.places(packet, &mut scratch, &mut places);
            densities.extend(found.into_iter().take(packet.len()));
            let seen = self.model.field.colors_at(&along, &places, &mut scratch);
            colors.extend(seen.into_iter().take(packet.len()));
        }
        let (mut sums, mut opacity, mut distance) = ([0.0; 3], 0.0, 0.0);
        let weights = intervals.weights(&densities);
        for ((weight, color), t) in weights.into_iter().zip(&colors).zip(&intervals.middles) {
            sums.iter_mut().zip(color).for_each(|(sum, value)| *sum += weight * value);
            (opacity, distance) = (opacity + weight, distance + weight * t);
        }
        let left = (1.0f64 - opacity).max(0.0);
        Light { sums, left, distance, last: colors.last().copied().unwrap_or_default() }
    }
}

/// The colour behind a scene whose rays are extended by their last sample: the mean over all
/// directions from the middle, weighted by the light that is left.
///
/// # Errors
/// Errors of loading.
#[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
pub(super) fn behind(file: &Arc<NerfactoFile>) -> Result<[f32; 3]> {
    let loaded = Loaded { file: Arc::clone(file), model: file.load()? };
    let middle = file.space.middle();
    let (mut sums, mut all) = ([0.0; 3], 0.0);
    for direction in all_around() {
        let light = loaded.light(middle, direction, 0.0);
        // If no ray leaves the scene, all count equally.
        let share = light.left + LEAST_LEFT;
        sums.iter_mut().zip(light.last).for_each(|(sum, value)| *sum += share * value);
        all += share;
    }
    Ok(sums.map(|sum| (sum / all).clamp(0.0, 1.0) as f32))
}

impl TrainedModel for Loaded {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        if progress.cancelled() {
            return ray_color([0.0; 3], 1.0, 0.0, rules);
        }
        let (origin, direction) = (ray.origin.to_array(), unit_direction(ray));
        let Light { mut sums, left, distance, last } =
            self.light(origin, direction, rules.near.into());
        let color = match self.file.settings.background {
            Background::LastSample => {
                sums.iter_mut().zip(last).for_each(|(sum, value)| *sum += left * value);
                sums
            }
            Background::Color(_) => over_background(sums, left, rules),
        };
        ray_color(color.map(|value| value.clamp(0.0, 1.0)), left, distance, rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let mut found = Vec::new();
        self.model.densities::<f64>(&[position], &mut FieldScratch::default(), &mut found);
        found.into_iter().sum::<f64>() as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let (mut scratch, mut places) = (FieldScratch::<f64>::default(), Places::default());
        self.model.places(&[position], &mut scratch, &mut places);
        let mut colors = Colors::default();
        let along = self.model.along(directions);
        self.model.field.colors_along(&along, &places, 0, &mut scratch, &mut colors);
        let [red, green, blue] = colors;
        let colors = red.into_iter().zip(green).zip(blue);
        colors.map(|((red, green), blue)| [red, green, blue].map(|value| value as f32)).collect()
    }
}
