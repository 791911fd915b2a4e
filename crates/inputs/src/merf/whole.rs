//! A whole scene by the rules of MERF's baked renderer.
//!
//! ```text
//! t_0 = near,  t_k+1 = t_k + voxel / (contracted length of a short step along the ray)
//! optical depth of sample k = density (t_k+1 - t_k), in the world
//! ```
//!
//! The background is added before the network runs, once per ray.

use std::sync::Arc;

use super::contraction::stretch;
use super::sums::{Assets, Sums, density};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::folder::{OPACITY, added_light};
use crate::model::activate::sigmoid;
use crate::model::camera::Ray;
use crate::model::ray_march::{
    Composite, SampleBudget, over_background, point_at, ray_color, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::model::view_mlp::ViewMlp;

/// Distance in world units at which a ray ends.
const FARTHEST: f64 = 1e10;
/// Transmittance below which a ray ends: anything behind is invisible.
const OPAQUE: f64 = 1e-7;

/// A folder and its network, ready to be loaded.
#[derive(Debug)]
pub(super) struct WholeModel {
    pub(super) assets: Arc<Assets>,
    pub(super) network: Option<ViewMlp>,
}

impl LoadModel for WholeModel {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Whole { sums: self.assets.sums()?, network: self.network.clone() }))
    }
}

#[derive(Debug)]
struct Whole {
    sums: Arc<Sums>,
    network: Option<ViewMlp>,
}

impl TrainedModel for Whole {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let parameters = &self.sums.parameters;
        let voxel = parameters.voxel_size();
        let world = unit_direction(ray);
        let origin = parameters.axes.within(ray.origin.to_array());
        let direction = parameters.axes.within(world);
        let mut light = Composite::<7>::default();
        let mut t = f64::from(rules.near).max(0.0);
        let mut left = SampleBudget::new(t, voxel, progress);
        while t < FARTHEST && light.transmittance > OPAQUE && left.take() {
            let at = point_at(origin, direction, t);
            let step = voxel / stretch(at, direction).max(f64::MIN_POSITIVE);
            if let Some([red, green, blue, sum, a, b, c, d]) = self.sums.shown(at) {
                let opacity = -libm::expm1(-density(sum) * step);
                light.add(opacity, t, |_| Some([red, green, blue, a, b, c, d].map(sigmoid)));
            }
            t += step;
        }
        let Composite { transmittance, sums: [red, green, blue, features @ ..], distance } = light;
        let mut color = over_background([red, green, blue], transmittance, rules);
        let added = added_light(self.network.as_ref(), world, color, &features);
        color.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        ray_color(color, transmittance, distance, rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let found = self.sums.shown(self.sums.parameters.axes.within(position));
        found.and_then(|found| found.get(OPACITY).copied()).map_or(0.0, density) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let found = self.sums.shown(self.sums.parameters.axes.within(position));
        let [red, green, blue, _, features @ ..] =
            found.map_or([0.0; 8], |values| values.map(sigmoid));
        let color = [red, green, blue];
        let seen = directions.iter().map(|&direction| {
            let mut seen = color;
            let added = added_light(self.network.as_ref(), direction, color, &features);
            seen.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
            seen.map(|value| value as f32)
        });
        seen.collect()
    }
}
