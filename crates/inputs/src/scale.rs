//! Inputs whose world is larger or smaller than the scene's.
//!
//! With a scale `F`, a point of the scene is `p` where the input has `F p`, and a density per world
//! unit is `F` times the input's. The optical depth of a step stays.

use std::sync::Arc;

use super::options::SourceOptions;
use super::source::Source;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// The source in the scene's world. Distances from the user are already in scene units.
///
/// # Errors
/// `InvalidOption` for a scale of the user's that leaves no box, `Malformed` for one of the file's.
pub(super) fn rescale(mut source: Source, options: &SourceOptions) -> Result<Source> {
    let scale = options.scene_scale.unwrap_or(source.scene_scale);
    let scene = &mut source.field.scene;
    let march = &mut scene.march;
    let shells = source.field.shells.iter_mut().map(|shell| &mut shell.lattice.bounds);
    let boxes = std::iter::once(&mut scene.bounds).chain(&mut march.sampled).chain(shells);
    for bounds in boxes {
        for corner in [&mut bounds.min, &mut bounds.max] {
            *corner = corner.map(|value| value / scale);
        }
    }
    march.voxel_size /= scale;
    march.voxel.iter_mut().flatten().for_each(|edge| *edge /= scale);
    march.near = options.near.unwrap_or(march.near / scale);
    march.far = options.far.or(march.far.map(|far| far / scale));
    if let Some(free_space) = &mut source.field.free_space {
        free_space.scale = free_space.scale.map(|per_unit| per_unit * f64::from(scale));
    }
    if scale != 1.0 {
        source.model = source.model.map(|model| -> Arc<dyn LoadModel> {
            Arc::new(ScaledSource { model, scale: f64::from(scale) })
        });
    }
    source.scene_scale = scale;
    let scene = &source.field.scene;
    let place = Place::Key("scene_scale".to_owned());
    let has_steps = scene.march.voxel_size > 0.0 && scene.march.voxel_size.is_finite();
    match (scene.bounds.check_model(&place), options.scene_scale) {
        (Ok(()), _) if scale == 1.0 || has_steps => Ok(source),
        (_, Some(scale)) => {
            let expected = "a scale that keeps the corners of the box within 1e10 of 0";
            Err(Error::invalid_option("scene_scale", scale.to_string(), expected))
        }
        (Err(error), None) => Err(error),
        (Ok(()), None) => {
            let expected = "a scale that keeps the size of voxels above 0";
            Err(Error::malformed(place, scale.to_string(), expected))
        }
    }
}

#[derive(Debug)]
struct ScaledSource {
    model: Arc<dyn LoadModel>,
    scale: f64,
}

impl LoadModel for ScaledSource {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        Ok(Box::new(Scaled { model: self.model.load(limits)?, scale: self.scale }))
    }
}

/// A model in the world of the scene.
#[derive(Debug)]
struct Scaled {
    model: Box<dyn TrainedModel>,
    scale: f64,
}

impl TrainedModel for Scaled {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let scale = self.scale as f32;
        let ray = Ray { origin: ray.origin * self.scale, direction: ray.direction };
        let (near, far) = (rules.near * scale, rules.far.map(|far| far * scale));
        let light = self.model.ray_color(&ray, &RayRules { near, far, ..*rules }, progress);
        RayColor { distance: light.distance / scale, ..light }
    }

    fn density(&self, position: [f64; 3]) -> f32 {
        self.scale as f32 * self.model.density(position.map(|value| value * self.scale))
    }

    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        self.model.colors(position.map(|value| value * self.scale), directions)
    }
}
