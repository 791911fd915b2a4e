//! The scene of a folder: a box of cubic voxels, whose nodes hold the opacity of one voxel.

use crate::base::error::{Place, Result};
use crate::model::field::{
    Activation, ActivationOrder, DensityFunction, EMPTY_LOGIT, March, Scene,
};
use crate::options::SourceOptions;
use crate::snerg::layout::FAINT;
use crate::sparse::CellBox;

/// The largest opacity: the least that the last 8-bit code may represent.
const OPAQUE: f64 = 254.5 / 255.0;

/// The scene of a box of cubes, by the rules that folders' viewers share.
///
/// # Errors
/// `Malformed` for a box without extent, at `place`.
pub fn scene(cells: &CellBox, options: &SourceOptions, place: &Place) -> Result<Scene> {
    let stepsize = options.stepsize.unwrap_or(1.0);
    let (order, function) = (ActivationOrder::Opacity, DensityFunction::Softplus);
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let march = March {
        stepsize,
        voxel_size: cells.voxel_size(),
        near: 0.0,
        far: None,
        color_threshold: options.color_threshold.unwrap_or(0.0),
        alpha_threshold: FAINT as f32,
        sampled: Some(cells.faces()),
        voxel: None,
    };
    Ok(Scene {
        bounds: cells.bounds([place; 2])?,
        nodes: cells.nodes(),
        activation: Activation { shift: 0.0, interval: stepsize, order, function },
        march,
        background: options.background.unwrap_or([1.0; 3]),
    })
}

/// The raw density of a node whose voxel has an opacity, 0 to 1.
#[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
pub fn raw_density(opacity: f64) -> f32 {
    match opacity > 0.0 {
        true => Activation::logits(0.0, 1.0).raw_at_opacity(opacity.min(OPAQUE)) as f32,
        false => EMPTY_LOGIT,
    }
}
