//! A folder by the rules of its own viewer: a march that skips empty cells, then a network per ray.

use std::fmt::Debug;
use std::sync::Arc;

use super::deferred::added_light;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, over_background, point_at, ray_color,
    unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::model::view_mlp::ViewMlp;
use crate::snerg::layout::OPAQUE;

/// Avoids divisions by 0.
const GUARD: ZeroGuard = ZeroGuard::Replace(f64::MIN_POSITIVE);

/// The sums of a ray: a colour and four features.
pub type Light = Composite<7>;

/// A box.
pub type Corners = [[f64; 3]; 2];

/// The samples of a ray, in lengths of the viewer's own space.
#[derive(Debug, Clone, Copy)]
pub struct Samples {
    /// The first one.
    pub start: f64,
    /// The end; samples lie before it.
    pub end: f64,
    /// From one to the next.
    pub step: f64,
    /// Maximum steps, including skipped cells.
    pub most: f64,
}

/// The differences between the viewers. Positions and distances are in the viewer's own space.
pub trait ViewerRules: Debug + Send + Sync {
    /// The network does not run above this transmittance.
    const CLEAR: f64;

    /// A position of the world.
    fn position(&self, world: [f64; 3]) -> [f64; 3];

    /// A direction of the world, whose length stays.
    fn direction(&self, world: [f64; 3]) -> [f64; 3];

    /// The box that holds everything.
    fn space(&self) -> Corners;

    /// The samples of a ray that enters the box and leaves it at two distances.
    fn samples(&self, crossing: [f64; 2], rules: &RayRules) -> Samples;

    /// Adds a sample at a position, with its distance from the origin and its length. Returns the
    /// cell to skip if it is empty.
    fn visit(&self, at: [f64; 3], along: [f64; 2], light: &mut Light) -> Option<Corners>;

    /// Optical depth per world unit at a position of the world.
    fn density(&self, world: [f64; 3]) -> f64;

    /// Colour and features at a position of the world.
    fn values(&self, world: [f64; 3]) -> ([f64; 3], [f64; 4]);
}

/// A folder that gives its viewer once loaded.
pub trait Viewed: Debug + Send + Sync {
    type Rules: ViewerRules + 'static;

    /// The rules, with all values.
    ///
    /// # Errors
    /// Errors of the pictures.
    fn rules(&self) -> Result<Self::Rules>;
}

/// A folder and its network, ready to be loaded.
#[derive(Debug)]
pub struct FolderModel<A> {
    pub assets: Arc<A>,
    pub network: Option<ViewMlp>,
}

impl<A: Viewed> LoadModel for FolderModel<A> {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Viewer { rules: self.assets.rules()?, network: self.network.clone() }))
    }
}

#[derive(Debug)]
struct Viewer<R> {
    rules: R,
    network: Option<ViewMlp>,
}

impl<R> Viewer<R> {
    /// A colour with the light that the network adds to it.
    fn lit(&self, direction: [f64; 3], mut color: [f64; 3], features: &[f64]) -> [f64; 3] {
        let added = added_light(self.network.as_ref(), direction, color, features);
        color.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        color
    }
}

impl<R: ViewerRules> TrainedModel for Viewer<R> {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let world = unit_direction(ray);
        let origin = self.rules.position(ray.origin.to_array());
        let direction = self.rules.direction(world);
        let [enters, leaves] = crossing(origin, direction, self.rules.space(), GUARD);
        let Samples { start: mut t, end, step, most } = self.rules.samples([enters, leaves], rules);
        let mut light = Light::default();
        let mut left = SampleBudget::new(t, 0.5 * step, progress);
        let mut steps = 0.0;
        while steps < most && light.transmittance > OPAQUE && t < end && left.take() {
            steps += 1.0;
            let along = [t, step.min(end - t)];
            t = match self.rules.visit(point_at(origin, direction, t), along, &mut light) {
                None => t + step,
                Some(cell) => {
                    let [_, exit] = crossing(origin, direction, cell, GUARD);
                    // A ray along an edge may leave where it enters.
                    exit.max(t) + 0.5 * step
                }
            };
        }
        let Light { transmittance, sums: [red, green, blue, features @ ..], distance } = light;
        let mut color = over_background([red, green, blue], transmittance, rules);
        if transmittance <= R::CLEAR {
            color = self.lit(world, color, &features);
        }
        ray_color(color, transmittance, distance, rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        self.rules.density(position) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let (color, features) = self.rules.values(position);
        let seen = directions
            .iter()
            .map(|&direction| self.lit(direction, color, &features).map(|value| value as f32));
        seen.collect()
    }
}
