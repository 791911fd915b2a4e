//! Trained models with their own rendering rules.

use std::fmt::Debug;

use super::camera::Ray;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::base::progress::Progress;

/// The light that comes along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayColor {
    /// Colour over the background, not clamped.
    pub color: [f32; 3],
    /// Light left behind the field, 0 to 1.
    pub transmittance: f32,
    /// Expected distance in world units; light that passes through the field has the distance
    /// `far`, if set.
    pub distance: f32,
}

/// Rules of a picture, independent of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayRules {
    /// Nearest distance of a sample, in world units along the ray.
    pub near: f32,
    /// Farthest distance at which sampling may start, likewise; `None` is unlimited.
    pub far: Option<f32>,
    /// Colour behind the field.
    pub background: [f32; 3],
}

impl RayRules {
    /// The farthest entry, in world units; infinite without a bound.
    pub fn farthest(&self) -> f64 {
        self.far.map_or(f64::INFINITY, f64::from)
    }
}

/// A trained model in memory, evaluated by the rules of the program that trained it: its sample
/// positions, activations and termination of rays.
///
/// Models with the rules of a [`RadianceField`](super::field::RadianceField) do not need it.
pub trait TrainedModel: Debug + Send + Sync {
    /// The light along a ray. Its direction need not have unit length. After a request to stop the
    /// light is incomplete.
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor;

    /// Optical depth per world unit at a position of the world; 0 outside.
    fn density(&self, position: [f64; 3]) -> f32;

    /// The colours at a position, seen along unit directions that point into the
    /// scene, before they are composited.
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]>;
}

impl dyn TrainedModel + '_ {
    /// The light along a ray, complete.
    ///
    /// # Errors
    /// A request to stop.
    pub fn follow(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> Result<RayColor> {
        let light = self.ray_color(ray, rules, progress);
        if progress.cancelled() { Err(Error::cancelled()) } else { Ok(light) }
    }
}

/// Loads a model's values into memory.
pub trait LoadModel: Debug + Send + Sync {
    /// The model.
    ///
    /// # Errors
    /// Errors of reading, and more memory than the limits allow.
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>>;
}
