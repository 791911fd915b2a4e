//! An unbounded scene by the rules of DirectVoxGO's renderer.
//!
//! ```text
//! N      = floor(2 / (2 + 2 b) nodes / stepsize) + 1
//! edges  = 0 to 2 in N even steps, then 2 / u, u from 1 to 1/128 in N even steps
//! t      = the middles between edges, in half sizes of the inner box from the ray's origin
//! counts : n <= 1, or the contracted way since the last reset is above 0.95 steps, which resets it
//! alpha  = 1 - exp(-softplus(raw + shift) interval), the same for each sample that counts
//! ```
//!
//! The rest is as in a box: thresholds of opacity and weight, and the end of a ray.

use std::sync::Arc;

use super::model::MIN_TRANSMITTANCE;
use super::world::{Whole, WorldFile};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::grid::Nodes;
use crate::model::ray_march::{Composite, Next, point_at, unit_direction, walk};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::nested::World;

/// The fraction of a step that must pass before a sample counts.
const COUNTS: f64 = 0.95;
/// Distance at which steps begin to grow, in half sizes of the inner box.
const GROWS: f64 = 2.0;
/// Factor from there to the end of the steps.
const FARTHEST: f64 = 128.0;

/// A checkpoint of an unbounded scene.
#[derive(Debug)]
pub(super) struct Unloaded(pub(super) Arc<WorldFile>);

impl LoadModel for Unloaded {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Loaded { file: Arc::clone(&self.0), whole: self.0.load()? }))
    }
}

#[derive(Debug)]
struct Loaded {
    file: Arc<WorldFile>,
    whole: Arc<Whole>,
}

/// Reach of rays, in half sizes of the inner box.
pub(super) const REACH: f64 = GROWS * FARTHEST;

impl Loaded {
    /// Number of even steps, and of growing steps.
    fn steps(&self) -> f64 {
        let Nodes([nodes, ..]) = self.file.density.nodes();
        let stepsize = f64::from(self.file.scene.march.stepsize);
        (nodes as f64 / (self.file.contraction.reach() * stepsize)).floor() + 1.0
    }

    /// The distance of an edge between samples, in half sizes of the inner box.
    fn edge(number: f64, steps: f64) -> f64 {
        match number <= steps {
            true => GROWS * number / steps,
            false => GROWS / (1.0 - (1.0 - 1.0 / FARTHEST) * (number - steps) / steps),
        }
    }
}

impl TrainedModel for Loaded {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let Self { file, whole } = self;
        let scene = &file.scene;
        let (contraction, radius) = (&file.contraction, file.contraction.radius());
        let origin = contraction.place(ray.origin.to_array()).own;
        let direction = unit_direction(ray);
        let steps = self.steps();
        let Nodes([nodes, ..]) = file.density.nodes();
        let stepsize = f64::from(scene.march.stepsize);
        let counts = COUNTS * 2.0 * contraction.reach() / nodes as f64 * stepsize;
        let near = f64::from(rules.near) / radius;
        let (mut light, mut number) = (Composite::<3>::default(), 0.0);
        let (mut way, mut last) = (0.0, None);
        let next = || {
            let middle = 0.5 * (Self::edge(number, steps) + Self::edge(number + 1.0, steps));
            number += 1.0;
            (number <= 2.0 * steps).then_some(middle)
        };
        walk(next, progress, |t| {
            let place = contraction.place_of(point_at(origin, direction, t));
            let at = contraction.contracted(place);
            way += last.map_or(0.0, |last| distance(last, at));
            last = Some(at);
            let is_far = way > counts;
            if is_far {
                way = 0.0;
            }
            if !(place.norm <= 1.0 || is_far) || t < near || !file.is_free(at) {
                return Next::Step;
            }
            let depth = file.density_at(whole, at) * f64::from(scene.activation.interval);
            let alpha = -libm::expm1(-depth);
            if alpha > f64::from(scene.march.alpha_threshold) {
                light.add(alpha, t * radius, |weight| {
                    let shows = weight > f64::from(scene.march.color_threshold);
                    shows.then(|| file.color_at(whole, at, direction))
                });
            }
            if light.transmittance >= MIN_TRANSMITTANCE { Next::Step } else { Next::End }
        });
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let mut found = Vec::new();
        self.file.densities(&self.whole, &[position], true, &mut found);
        found.into_iter().sum::<f64>() as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let contraction = &self.file.contraction;
        let at = contraction.contracted(contraction.place(position));
        let seen = directions.iter().map(|&along| self.file.color_at(&self.whole, at, along));
        seen.map(|color| color.map(|value| value as f32)).collect()
    }
}

fn distance(one: [f64; 3], other: [f64; 3]) -> f64 {
    let squares = one.into_iter().zip(other).map(|(one, other)| (one - other) * (one - other));
    squares.sum::<f64>().sqrt()
}
