//! A model by the rules of the program that trained it.

use std::sync::Arc;

use super::evaluate::{Ngp, harmonics};
use super::file::NgpFile;
use super::frame::Frame;
use super::perceptron::LANES;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::trained_model::{LoadModel, RayColor, RayRules, Samples, TrainedModel};

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

/// A ray in the unit cube.
struct Path {
    origin: [f64; 3],
    direction: [f64; 3],
    /// The next sample, and the end.
    t: f64,
    end: f64,
}

impl Loaded {
    /// The next samples in occupied cells, in their order.
    fn next(&self, path: &mut Path, left: &mut Samples) -> Vec<(f64, [f64; 3])> {
        let mut samples = Vec::with_capacity(LANES);
        while samples.len() < LANES && path.t <= path.end && left.take() {
            let mut at = path.origin;
            at.iter_mut().zip(path.direction).for_each(|(at, by)| *at += path.t * by);
            if self.file.occupancy.contains(at) {
                samples.push((path.t, at));
            }
            path.t += self.file.rules.step;
        }
        samples
    }
}

impl TrainedModel for Loaded {
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let (frame, own) = (self.file.frame, self.file.rules);
        let unit = (ray.direction / ray.direction.length()).to_array();
        let origin = frame.to_cube(ray.origin.to_array());
        let direction = Frame::turned(unit);
        let (mut enters, mut leaves) = (0.0f64, f64::INFINITY);
        for (from, by) in origin.into_iter().zip(direction) {
            let by = if by == 0.0 { f64::MIN_POSITIVE } else { by };
            let (a, b) = (-from / by, (1.0 - from) / by);
            (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
        }
        let far = rules.far.map_or(f64::INFINITY, |far| f64::from(far) * frame.scale);
        let start = enters.min(far).max(f64::from(rules.near) * frame.scale);
        let mut path = Path { origin, direction, t: start, end: leaves };
        let seen = harmonics(&[unit; LANES]);
        let (mut transmittance, mut sums, mut distance) = (1.0, [0.0; 3], 0.0);
        let mut left = Samples::new(enters.max(start), own.step, progress);
        'ray: loop {
            let samples = self.next(&mut path, &mut left);
            if samples.is_empty() {
                break;
            }
            let positions: Vec<[f64; 3]> = samples.iter().map(|(_, at)| *at).collect();
            let geometry = self.model.geometry(&positions);
            let densities = self.model.densities(&geometry);
            let colors = seen.first().map(|seen| self.model.colors(&geometry, seen));
            let lanes = densities.into_iter().zip(colors.unwrap_or([[0.0; 3]; LANES]));
            for ((t, _), (density, color)) in samples.into_iter().zip(lanes) {
                let alpha = -libm::expm1(-density * own.step);
                let weight = alpha * transmittance;
                transmittance *= 1.0 - alpha;
                sums.iter_mut().zip(color).for_each(|(sum, value)| *sum += weight * value);
                distance += weight * t / frame.scale;
                if transmittance < own.min_transmittance {
                    if own.divides {
                        let whole = 1.0 - transmittance;
                        sums = sums.map(|sum| sum / whole);
                        (distance, transmittance) = (distance / whole, 0.0);
                    }
                    break 'ray;
                }
            }
        }
        let mut color = rules.background;
        for (value, sum) in color.iter_mut().zip(sums) {
            *value = (sum + transmittance * f64::from(*value)) as f32;
        }
        let distance = (distance + transmittance * rules.far.map_or(0.0, f64::from)) as f32;
        RayColor { color, transmittance: transmittance as f32, distance }
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let at = self.file.frame.to_cube(position);
        if !self.file.occupancy.contains(at) {
            return 0.0;
        }
        let [density, ..] = self.model.densities(&self.model.geometry(&[at]));
        (density * self.file.frame.scale) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let geometry = self.model.geometry(&[self.file.frame.to_cube(position)]);
        let colors = self.model.colors_along(&geometry, 0, &harmonics(directions));
        let colors = colors.into_iter().take(directions.len());
        colors.map(|color| color.map(|value| value as f32)).collect()
    }
}
