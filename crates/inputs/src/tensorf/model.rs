//! TensoRF by the rules of its own renderer.
//!
//! ```text
//! t      = entry of the box (between near and far) + k step, k = 0, 1, ...
//! depth  = softplus(density + shift) step distance_scale, where the mask is above 0; else 0
//! alpha  = 1 - exp(-depth), and 0 at the last sample
//! weight = alpha T,  T *= 1 - alpha + 1e-10
//! colour = sum of weight shading, where a weight is over the threshold
//! ```

use super::keys::{Arrays, Settings};
use super::mask::Mask;
use super::shading::Shading;
use super::two_passes;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::factors::{Mixed, Scratch, Tap};
use crate::model::activate;
use crate::model::camera::Ray;
use crate::model::ray_march::{over_background, point_at, ray_color, unit_direction};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// Added to the light that passes through a sample.
const PASSES: f64 = 1e-10;

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct TensorfFile {
    pub(super) arrays: Arrays,
}

/// A model in memory.
#[derive(Debug)]
struct Tensorf {
    settings: Settings,
    density: Mixed,
    /// Number of colour features.
    features: Mixed,
    shading: Shading,
    mask: Option<Mask>,
}

impl LoadModel for TensorfFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Tensorf::load(&self.arrays, &mut Budget::new(limits))?))
    }
}

impl Tensorf {
    /// Reads a model's arrays.
    fn load(arrays: &Arrays, budget: &mut Budget) -> Result<Self> {
        Ok(Self {
            settings: arrays.settings.clone(),
            density: arrays.density.load(budget)?,
            features: arrays.features.load(budget)?,
            shading: arrays.shading.load(budget)?,
            mask: arrays.mask.as_ref().map(|mask| mask.load(budget)).transpose()?,
        })
    }

    /// A position of the world, 0 to 1 in the box.
    fn share(&self, world: [f64; 3]) -> [f64; 3] {
        let bounds = &self.settings.bounds;
        let mut share = world;
        let axes = share.iter_mut().zip(bounds.min).zip(bounds.extent());
        axes.for_each(|((at, min), extent)| *at = (*at - f64::from(min)) / extent);
        share
    }

    fn taps(&self, share: [f64; 3]) -> [Tap; 3] {
        let mut at = [Tap::on(0); 3];
        for ((at, share), count) in at.iter_mut().zip(share).zip(self.settings.nodes.0) {
            *at = Tap::at(share * (count - 1) as f64, count);
        }
        at
    }

    /// Optical depth per world unit at a position; 0 in empty space.
    fn sigma(&self, world: [f64; 3], share: [f64; 3], scratch: &mut Scratch) -> f64 {
        let inside = share.into_iter().all(|at| (0.0..=1.0).contains(&at));
        if !inside || !self.mask.as_ref().is_none_or(|mask| mask.contains(world)) {
            return 0.0;
        }
        let raw = self.density.sum(&self.taps(share), scratch);
        let density = match self.settings.shift {
            Some(shift) => activate::softplus(raw + shift),
            None => raw.max(0.0),
        };
        density * self.settings.distance_scale
    }

    fn color(
        &self,
        share: [f64; 3],
        directions: &[[f64; 3]],
        scratch: &mut Scratch,
    ) -> Vec<[f64; 3]> {
        let features = self.features.values(&self.taps(share), scratch);
        let at = share.map(|at| 2.0 * at - 1.0);
        directions.iter().map(|&along| self.shading.color(&features, at, along)).collect()
    }
}

/// TensoRF's samples of a ray, in float32: the first one lies on a face, and rounding decides
/// whether it is in the box.
struct Samples {
    origin: [f32; 3],
    direction: [f32; 3],
    start: f32,
    step: f32,
    /// The distance at which the ray leaves the box.
    end: f32,
}

impl Samples {
    #[expect(clippy::cast_possible_truncation, reason = "TensoRF's rays are float32")]
    fn new(ray: &Ray, rules: &RayRules, settings: &Settings) -> Self {
        let direction = unit_direction(ray);
        let [origin, direction] =
            [ray.origin.to_array(), direction].map(|at| at.map(|value| value as f32));
        let (bounds, nodes) = (&settings.bounds, settings.nodes.0);
        let (mut start, mut end, mut voxels) = (f32::NEG_INFINITY, f32::INFINITY, 0.0);
        let corners = bounds.min.into_iter().zip(bounds.max).zip(nodes);
        let rays = origin.into_iter().zip(direction);
        for ((from, by), ((low, high), count)) in rays.zip(corners) {
            let by = if by == 0.0 { 1e-6 } else { by };
            let (a, b) = ((low - from) / by, (high - from) / by);
            (start, end) = (start.max(a.min(b)), end.min(a.max(b)));
            voxels += (high - low) / (count - 1) as f32;
        }
        let start = start.min(rules.far.unwrap_or(f32::INFINITY)).max(rules.near);
        let step = voxels / 3.0 * settings.step_ratio as f32;
        Self { origin, direction, start, step, end }
    }

    /// The distance and the position of a sample; none behind the box.
    fn at(&self, number: f32) -> Option<(f32, [f32; 3])> {
        let t = self.start + self.step * number;
        let mut at = self.origin;
        at.iter_mut().zip(self.direction).for_each(|(at, by)| *at += by * t);
        (t <= self.end + self.step).then_some((t, at))
    }
}

impl Tensorf {
    /// The light along a ray by nerfstudio's rules.
    fn in_two_passes(&self, counts: [usize; 2], ray: &Ray, rules: &RayRules) -> RayColor {
        let (direction, bounds) = (unit_direction(ray), &self.settings.bounds);
        let origin = ray.origin.to_array();
        let corners = [bounds.min, bounds.max].map(|corner| corner.map(f64::from));
        let [enters, leaves] = two_passes::span(origin, direction, corners);
        let enters = enters.max(f64::from(rules.near)).min(leaves);
        let mut scratch = Scratch::default();
        let place = |t: f64| {
            let world = point_at(origin, direction, t);
            (world, self.share(world))
        };
        let ends = two_passes::intervals(counts, [enters, leaves], |t| {
            let (world, share) = place(t);
            self.sigma(world, share, &mut scratch)
        });
        let mut light = Light::default();
        let mut depth = 0.0;
        for interval in ends.windows(2) {
            let &[from, to] = interval else { continue };
            let t = 0.5 * (from + to);
            let (world, share) = place(t);
            let own = (to - from) * self.sigma(world, share, &mut scratch);
            let weight = -libm::expm1(-own) * libm::exp(-depth);
            depth += own;
            if weight > 0.0 {
                let seen = self.color(share, &[direction], &mut scratch);
                light.add(weight, t, seen.first().copied());
            }
        }
        light.over(rules)
    }
}

/// The accumulated light of samples.
#[derive(Debug, Default)]
struct Light {
    color: [f64; 3],
    opacity: f64,
    distance: f64,
}

impl Light {
    /// Adds a sample; one of a low weight has no colour.
    fn add(&mut self, weight: f64, distance: f64, color: Option<[f64; 3]>) {
        (self.opacity, self.distance) = (self.opacity + weight, self.distance + weight * distance);
        let seen = color.unwrap_or_default();
        self.color.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += weight * seen);
    }

    /// The light over the background, clamped to 0 to 1.
    fn over(&self, rules: &RayRules) -> RayColor {
        let left = (1.0 - self.opacity).max(0.0);
        let color = over_background(self.color, left, rules);
        ray_color(color.map(|value| value.clamp(0.0, 1.0)), left, self.distance, rules)
    }
}

impl TrainedModel for Tensorf {
    #[expect(clippy::cast_possible_truncation, reason = "samples are few")]
    fn ray_color(&self, ray: &Ray, rules: &RayRules, _: &dyn Progress) -> RayColor {
        let settings = &self.settings;
        if let Some(counts) = settings.two_passes {
            return self.in_two_passes(counts, ray, rules);
        }
        let direction = unit_direction(ray);
        let step = settings.voxel_size() * settings.step_ratio;
        let along = Samples::new(ray, rules, settings);
        let diagonal = settings.bounds.extent().iter().map(|edge| edge * edge).sum::<f64>().sqrt();
        // The last of the samples has no length.
        let samples = (diagonal / step).floor() as f32;
        let mut scratch = Scratch::default();
        let (mut passes, mut light, mut number) = (1.0, Light::default(), 0.0);
        while number < samples {
            let Some((t, at)) = along.at(number) else { break };
            number += 1.0;
            let t = f64::from(t);
            let world = at.map(f64::from);
            let share = self.share(world);
            let sigma = self.sigma(world, share, &mut scratch);
            if sigma <= 0.0 {
                passes *= 1.0 + PASSES;
                continue;
            }
            let alpha = -libm::expm1(-sigma * step);
            let weight = alpha * passes;
            passes *= 1.0 - alpha + PASSES;
            let shows = weight > settings.threshold;
            let seen = shows.then(|| self.color(share, &[direction], &mut scratch));
            light.add(weight, t, seen.and_then(|seen| seen.first().copied()));
        }
        light.over(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        self.sigma(position, self.share(position), &mut Scratch::default()) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let colors = self.color(self.share(position), directions, &mut Scratch::default());
        colors.into_iter().map(|color| color.map(|value| value as f32)).collect()
    }
}
