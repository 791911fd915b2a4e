//! DirectVoxGO by the rules of its own renderer.
//!
//! ```text
//! t      = entry of the box (between near and far) + k step, k = 0, 1, ...
//! alpha  = 1 - exp(-softplus(raw + shift) interval), left out at or below the threshold
//! weight = alpha T,  T *= 1 - alpha, and the ray ends below 1e-3
//! colour = sum of weight network(features, direction), where a weight is over the threshold
//! ```
//!
//! In contracted scenes samples are counted from the camera: `t = (k + 1/2) step`.

use super::values::Values;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::checkpoint::{Inner, StoredGrid};
use crate::model::camera::Ray;
use crate::model::field::RadianceField;
use crate::model::grid::{Bounds, Nodes};
use crate::model::ray_march::{
    Composite, Next, Steps, ZeroGuard, crossing, point_at, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::network::{Network, NetworkFile};

/// Transmittance below which a ray ends.
pub(super) const MIN_TRANSMITTANCE: f64 = 1e-3;
/// Samples at most this far beyond a face, in nodes, lie on it.
const ON_FACE: f64 = 1e-6;

/// A checkpoint, ready to be loaded.
#[derive(Debug)]
pub(super) struct DvgoFile {
    /// Density, settings and the mask.
    pub(super) field: RadianceField,
    pub(super) density: StoredGrid,
    /// All features.
    pub(super) color: StoredGrid,
    pub(super) network: NetworkFile,
    /// The inner box of a contracted scene.
    pub(super) inner: Option<Inner>,
}

/// A model in memory.
#[derive(Debug)]
struct Dvgo {
    field: RadianceField,
    density: Values,
    features: Values,
    network: Network,
    /// Distance of samples of a contracted scene, which start at the camera.
    from_camera: Option<f64>,
}

impl LoadModel for DvgoFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let mut budget = Budget::new(limits);
        let network = self.network.load(&mut budget)?;
        let density = Values::load(&self.density, &mut budget)?;
        let features = Values::load(&self.color, &mut budget)?;
        let from_camera = self.inner.as_ref().map(|inner| self.step_from_camera(inner));
        Ok(Box::new(Dvgo { field: self.field.clone(), density, features, network, from_camera }))
    }
}

impl DvgoFile {
    /// Twice the radius, in as many whole steps as the inner box has.
    fn step_from_camera(&self, inner: &Inner) -> f64 {
        let (scene, Nodes([side, _, _])) = (&self.field.scene, self.field.scene.nodes);
        let [edge, _, _] = scene.bounds.extent();
        let share = 2.0 * inner.radius / edge;
        let steps = (share * side as f64 / f64::from(scene.march.stepsize)).floor() + 1.0;
        2.0 * inner.radius / steps
    }
}

impl Dvgo {
    /// A position of the world in nodes.
    fn to_nodes(&self, world: [f64; 3]) -> [f64; 3] {
        let (bounds, nodes) = (&self.field.scene.bounds, self.field.scene.nodes);
        let mut at = world;
        let axes = at.iter_mut().zip(bounds.min).zip(nodes.spacing(bounds));
        axes.for_each(|((at, min), spacing)| *at = (*at - f64::from(min)) / spacing);
        at
    }

    /// Optical depth of a step at a position; 0 outside the mask.
    fn depth(&self, world: [f64; 3]) -> f64 {
        let (at, Nodes(counts)) = (self.to_nodes(world), self.field.scene.nodes);
        let on =
            |(at, count): (f64, usize)| (-ON_FACE..=(count - 1) as f64 + ON_FACE).contains(&at);
        let sampled = |bounds: &Bounds| {
            let mut axes = world.into_iter().zip(bounds.min).zip(bounds.max);
            axes.all(|((at, min), max)| (f64::from(min)..=f64::from(max)).contains(&at))
        };
        let inside = at.into_iter().zip(counts).all(on)
            && self.field.scene.march.sampled.as_ref().is_none_or(sampled);
        let masked =
            |field: &RadianceField| field.free_space.as_ref().is_none_or(|m| m.contains(world));
        if !inside || !masked(&self.field) {
            return 0.0;
        }
        let raw: f64 = self.density.at(counts, at).into_iter().sum();
        let activation = &self.field.scene.activation;
        activation.density(raw) * f64::from(activation.interval)
    }

    fn color(&self, world: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let features = self.features.at(self.field.scene.nodes.0, self.to_nodes(world));
        let seen = |&along: &[f64; 3]| self.network.color(&features, [0.0; 3], along);
        directions.iter().map(seen).collect()
    }

    fn step(&self) -> f64 {
        let march = &self.field.scene.march;
        march.interval_length()
    }
}

impl TrainedModel for Dvgo {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let (origin, direction) = (ray.origin.to_array(), unit_direction(ray));
        let march = &self.field.scene.march;
        let bounds = march.sampled.as_ref().unwrap_or(&self.field.scene.bounds);
        let corners = [bounds.min, bounds.max].map(|corner| corner.map(f64::from));
        let [enters, leaves] = crossing(origin, direction, corners, ZeroGuard::Replace(1e-6));
        let enters = enters.min(rules.farthest()).max(f64::from(rules.near));
        let (start, step) = match self.from_camera {
            Some(step) => ((enters / step - 0.5).ceil() * step + 0.5 * step, step),
            None => (enters, self.step()),
        };
        let mut light = Composite::<3>::default();
        let steps = Steps { start, step, end: leaves + ON_FACE };
        steps.walk(0.0, progress, |t| {
            let world = point_at(origin, direction, t);
            let alpha = -libm::expm1(-self.depth(world));
            if alpha > f64::from(march.alpha_threshold) {
                light.add(alpha, t, |weight| {
                    let shows = weight > f64::from(march.color_threshold);
                    let seen = shows.then(|| self.color(world, &[direction]));
                    seen.and_then(|seen| seen.first().copied())
                });
            }
            if light.transmittance >= MIN_TRANSMITTANCE { Next::Step } else { Next::End }
        });
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        (self.depth(position) / self.step()) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let colors = self.color(position, directions);
        colors.into_iter().map(|color| color.map(|value| value as f32)).collect()
    }
}
