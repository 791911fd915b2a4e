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
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, point_at, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

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
    fn next(&self, path: &mut Path, left: &mut SampleBudget) -> Vec<(f64, [f64; 3])> {
        let mut samples = Vec::with_capacity(LANES);
        while samples.len() < LANES && path.t <= path.end && left.take() {
            let at = point_at(path.origin, path.direction, path.t);
            if self.file.occupancy.contains(at) {
                samples.push((path.t, at));
            }
            path.t += self.file.rules.step;
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
        let [enters, end] = crossing(origin, direction, [[0.0; 3], [1.0; 3]], guard);
        let (enters, far) = (enters.max(0.0), rules.farthest() * frame.scale);
        let t = enters.min(far).max(f64::from(rules.near) * frame.scale);
        let mut path = Path { origin, direction, t, end };
        let seen = harmonics(&[unit; LANES]);
        let mut light = Composite::<3>::default();
        let mut left = SampleBudget::new(enters.max(t), own.step, progress);
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
                light.add(alpha, t / frame.scale, |_| Some(color));
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
