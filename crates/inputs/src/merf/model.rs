//! A folder's core by the rules of its own viewer.

use std::sync::Arc;

use super::sums::{Assets, Sums, density};
use super::texel::DENSITY;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::folder::added_light;
use crate::model::activate::sigmoid;
use crate::model::camera::Ray;
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, over_background, point_at, ray_color,
    unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::model::view_mlp::ViewMlp;
use crate::snerg::layout::{FAINT, OPAQUE};

/// The core of contracted space.
const CORE: [[f64; 3]; 2] = [[-1.0; 3], [1.0; 3]];

/// Against divisions by 0.
const GUARD: ZeroGuard = ZeroGuard::Replace(f64::MIN_POSITIVE);

/// A folder and its network, ready to be loaded.
#[derive(Debug)]
pub(super) struct FolderModel {
    pub(super) assets: Arc<Assets>,
    pub(super) network: Option<ViewMlp>,
}

impl LoadModel for FolderModel {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Merf { sums: self.assets.sums()?, network: self.network.clone() }))
    }
}

#[derive(Debug)]
struct Merf {
    sums: Arc<Sums>,
    network: Option<ViewMlp>,
}

impl Merf {
    /// Sums at a position of the world, where a ray takes samples.
    fn at(&self, world: [f64; 3]) -> Option<[f64; 8]> {
        let own = self.sums.parameters.axes.within(world);
        let inside = own.iter().all(|at| at.abs() <= 1.0);
        let shown = inside && self.sums.occupancy.empty_cell(own).is_none();
        shown.then(|| self.sums.at(own, 0.0)).flatten()
    }

    /// Steps that a ray takes, at most.
    fn most_steps(&self) -> f64 {
        let parameters = &self.sums.parameters;
        // The viewer counts the voxels along the diagonal of a plane, else of the grid.
        let axes: f64 = if parameters.planes.is_some() { 2.0 } else { 3.0 };
        (axes.sqrt() * parameters.resolution() as f64).ceil()
    }
}

impl TrainedModel for Merf {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let parameters = &self.sums.parameters;
        let step = parameters.voxel_size();
        let world = unit_direction(ray);
        let origin = parameters.axes.within(ray.origin.to_array());
        let direction = parameters.axes.within(world);
        let [enters, leaves] = crossing(origin, direction, CORE, GUARD);
        let leaves = leaves.min(rules.farthest());
        let mut light = Composite::<7>::default();
        let mut t = enters.max(f64::from(rules.near)).max(0.0);
        let mut left = SampleBudget::new(t, 0.5 * step, progress);
        let mut steps = 0.0;
        while steps < self.most_steps()
            && light.transmittance > OPAQUE
            && t <= leaves
            && left.take()
        {
            steps += 1.0;
            let at = point_at(origin, direction, t);
            if let Some(cell) = self.sums.occupancy.empty_cell(at) {
                let [_, exit] = crossing(origin, direction, cell, GUARD);
                t = exit.max(t) + 0.5 * step;
                continue;
            }
            let length = step.min(leaves - t);
            if let Some(values) = self.sums.at(at, 0.0) {
                let [red, green, blue, sum, a, b, c, d] = values;
                let opacity = -libm::expm1(-density(sum) * length);
                if opacity > FAINT {
                    let seen = [red, green, blue, a, b, c, d].map(sigmoid);
                    light.add(opacity, t, |_| Some(seen));
                }
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
        let sum = self.at(position).and_then(|values| values.get(DENSITY).copied());
        sum.map_or(0.0, density) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let values = self.at(position).map_or([0.0; 8], |values| values.map(sigmoid));
        let [red, green, blue, _, features @ ..] = values;
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
