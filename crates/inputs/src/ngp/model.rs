//! A model by the rules of the program that trained it.

use std::sync::Arc;

use super::evaluate::Ngp;
use super::file::{Growth, NgpFile, Rules};
use super::frame::Frame;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, point_at, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::network::Colors;
use crate::packets::{FieldScratch, LANES, Places};

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct Unloaded(pub(super) Arc<NgpFile>);

impl LoadModel for Unloaded {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        let model = self.0.load()?;
        Ok(Box::new(Loaded { file: Arc::clone(&self.0), model }))
    }
}

#[derive(Debug)]
struct Loaded {
    file: Arc<NgpFile>,
    model: Arc<Ngp>,
}

/// Distance from the entry to the origin of growing steps, in edges of the unit cube.
const BEHIND: f64 = 1e-6;

/// A ray in the unit cube.
struct Path {
    origin: [f64; 3],
    direction: [f64; 3],
    /// The next sample, and the end.
    t: f64,
    end: f64,
    /// Steps to the next sample, where they grow.
    number: f64,
}

/// A sample position.
struct Sample {
    t: f64,
    at: [f64; 3],
    /// To the next one.
    step: f64,
}

impl Path {
    /// Goes to the next sample. Returns the step.
    fn advance(&mut self, rules: &Rules) -> f64 {
        let step = match &rules.growth {
            Growth::None => rules.step,
            Growth::Share { share, longest } => (self.t * share).max(rules.step).min(*longest),
            Growth::Ratio(growing) => {
                self.number += 1.0;
                growing.distance(self.number) - self.t
            }
        };
        self.t += step;
        step
    }
}

impl Loaded {
    /// The next samples in occupied cells, in their order.
    fn next(&self, path: &mut Path, left: &mut SampleBudget) -> Vec<Sample> {
        let mut samples = Vec::with_capacity(LANES);
        while samples.len() < LANES && path.t <= path.end && left.take() {
            let (t, at) = (path.t, point_at(path.origin, path.direction, path.t));
            let step = path.advance(&self.file.rules);
            let occupancy = &self.file.occupancy;
            let is_occupied = match self.file.rules.growth {
                Growth::Share { .. } => occupancy.contains_by_step(at, step),
                Growth::None | Growth::Ratio(_) => occupancy.contains(at),
            };
            if is_occupied {
                samples.push(Sample { t, at, step });
            }
        }
        samples
    }
}

impl TrainedModel for Loaded {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let (frame, own) = (self.file.frame, self.file.rules);
        let unit = unit_direction(ray);
        let (origin, direction) = (frame.to_cube(ray.origin.to_array()), Frame::turned(unit));
        let guard = ZeroGuard::Replace(f64::MIN_POSITIVE);
        let corners = [0.5 - 0.5 * self.file.span, 0.5 + 0.5 * self.file.span];
        let [enters, end] = crossing(origin, direction, corners.map(|at| [at; 3]), guard);
        let (enters, far) = (enters.max(0.0), rules.farthest() * frame.scale);
        let t = enters.min(far).max(f64::from(rules.near) * frame.scale);
        // Growing steps are counted from slightly behind the entry.
        let (t, number) = match own.growth {
            Growth::Ratio(growing) => (t + BEHIND, growing.number(t + BEHIND)),
            Growth::None | Growth::Share { .. } => (t, 0.0),
        };
        let mut path = Path { origin, direction, t, end, number };
        let seen = self.model.along::<f64>(&[unit]);
        let (mut scratch, mut places) = (FieldScratch::default(), Places::default());
        let mut light = Composite::<3>::default();
        let mut left = SampleBudget::new(enters.max(t), own.step, progress);
        'ray: loop {
            let samples = self.next(&mut path, &mut left);
            if samples.is_empty() {
                break;
            }
            let positions: Vec<[f64; 3]> = samples.iter().map(|sample| sample.at).collect();
            let densities = self.model.places(&positions, &mut scratch, &mut places);
            let colors = self.model.field.colors_at(&seen, &places, &mut scratch);
            let lanes = densities.into_iter().zip(colors);
            for (sample, (density, color)) in samples.into_iter().zip(lanes) {
                let alpha = -libm::expm1(-density * sample.step);
                light.add(alpha, sample.t / frame.scale, |_| Some(color));
                if light.transmittance < own.min_transmittance {
                    if own.divides {
                        light.divide_by_opacity();
                    }
                    break 'ray;
                }
            }
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let at = self.file.frame.to_cube(position);
        if !self.file.shows(at) {
            return 0.0;
        }
        let mut found = Vec::new();
        self.model.densities::<f64>(&[at], &mut FieldScratch::default(), &mut found);
        (found.into_iter().sum::<f64>() * self.file.frame.scale) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let (mut scratch, mut places) = (FieldScratch::default(), Places::default());
        let along = self.model.along::<f64>(directions);
        self.model.places(&[self.file.frame.to_cube(position)], &mut scratch, &mut places);
        let mut colors = Colors::default();
        self.model.field.colors_along(&along, &places, 0, &mut scratch, &mut colors);
        let [red, green, blue] = colors;
        let colors = red.into_iter().zip(green).zip(blue);
        colors.map(|((red, green), blue)| [red, green, blue].map(|value| value as f32)).collect()
    }
}
