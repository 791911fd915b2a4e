//! Opens a file of TensoRF as a field, and as a model with its own rules.

use std::sync::Arc;

use super::keys::{self, Arrays, Settings};
use super::model::TensorfFile;
use super::nerfstudio;
use super::shading::ShadingFile;
use super::values::ColorValues;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::factors::FactorGrid;
use crate::model::field::{Activation, ColorDomain, Grid, March, NodeValues, RadianceField, Scene};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::network::{FittedColors, ProjectedColors, StoredFeatures, fit_assumption};
use crate::options::{SourceOptions, ViewChoice};
use crate::source::{Family, Source};
use crate::tensor::TensorFile;

/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// The degree of the shading `SH`, and the default degree of a fit.
const DEGREE: usize = 2;

/// True for a file with the keys of TensoRF, or with those of nerfstudio's `tensorf`.
pub fn knows(file: &TensorFile) -> bool {
    keys::knows(file) || nerfstudio::knows(file)
}

/// Opens a file of TensoRF. Factors stay in the file until a node is requested.
///
/// # Errors
/// `Unsupported` for other activations and shadings, and scenes in normalised
/// device coordinates; `Malformed` if arrays are missing or do not fit.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let other = nerfstudio::knows(file);
    let mut arrays = match other {
        true => nerfstudio::find(file, limits)?,
        false => Arrays::find(file, limits)?,
    };
    let pictures = match other {
        true => Some(nerfstudio::pictures(file.file.path(), options.background, limits)?),
        false => None,
    };
    let settings = &mut arrays.settings;
    settings.two_passes = pictures.as_ref().map(|run| run.passes);
    settings.step_ratio = options.stepsize.map_or(settings.step_ratio, f64::from);
    settings.threshold = options.color_threshold.map_or(settings.threshold, f64::from);
    let background = pictures.as_ref().map(|run| run.background);
    let scene = scene(settings, background, options);
    let (side_file, mut assumptions) =
        pictures.map_or_else(Default::default, |run| (run.file, run.assumptions));
    // Colours of the model are clamped at each sample; those of a network were fitted.
    let (stored, evaluation) = match arrays.shading {
        ShadingFile::Rgb => (None, Evaluation::Ray),
        ShadingFile::Harmonics => (Some(DEGREE), Evaluation::Sample),
        ShadingFile::Network(_) => (Some(Harmonics::MAX_DEGREE), Evaluation::Ray),
    };
    let harmonics = stored.map(|most| {
        let degree = match options.view {
            ViewChoice::Keep => DEGREE,
            ViewChoice::Harmonics(wanted) => most.min(wanted),
            ViewChoice::None => 0,
        };
        Harmonics { degree, evaluation, offset: OFFSET, clamp: Clamp::Zero }
    });
    let plain = options.view == ViewChoice::None;
    if let (ShadingFile::Network(_), Some(Harmonics { degree, .. })) = (&arrays.shading, harmonics)
    {
        assumptions.push(fit_assumption(degree, plain, &options.cameras));
    }
    let free_space = arrays.mask.as_ref().map(|mask| mask.free_space(limits)).transpose()?;
    let density = FactorGrid::new(arrays.density.clone(), 1, limits);
    let mut field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(density)),
        color: Vec::new(),
        color_domain: ColorDomain::Linear,
        view: harmonics.filter(|_| !plain).map(ViewDependence::Harmonics),
        free_space,
        shells: Vec::new(),
    };
    let colors: Arc<dyn NodeValues> = match (&arrays.shading, harmonics) {
        (ShadingFile::Network(network), Some(rules)) => {
            let (features, geometry) = (arrays.features.clone(), field.clone());
            let channels = features.channels;
            let features = Grid::Values(Arc::new(FactorGrid::new(features, channels, limits)));
            let features = StoredFeatures::new(features, network.clone(), limits);
            let fitted = FittedColors::new(features, rules, geometry, &options.cameras, limits);
            Arc::new(ProjectedColors::new(if plain { fitted.plain() } else { fitted }))
        }
        _ => Arc::new(ColorValues::new(&arrays, harmonics, plain, limits)),
    };
    field.color.push(Grid::Values(colors));
    field.check()?;
    Ok(Source {
        field,
        model: Some(Arc::new(TensorfFile { arrays })),
        family: Family::Tensorf,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        scene_scale: 1.0,
        assumptions,
        recorded: match other {
            true => Vec::new(),
            false => vec!["stepsize", "near", "far", "color_threshold"],
        },
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: side_file.into_iter().collect(),
    })
}

/// The scene of the field.
#[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
fn scene(settings: &Settings, background: Option<[f32; 3]>, options: &SourceOptions) -> Scene {
    let voxel_size = settings.voxel_size();
    let interval = (settings.step_ratio * voxel_size * settings.distance_scale) as f32;
    let (near, far) = (settings.near as f32, settings.far.map(|far| far as f32));
    Scene {
        bounds: settings.bounds,
        nodes: settings.nodes,
        activation: match settings.shift {
            Some(shift) => Activation::logits(shift as f32, interval),
            None => Activation::relu(interval),
        },
        march: March {
            stepsize: settings.step_ratio as f32,
            voxel_size: voxel_size as f32,
            near: options.near.unwrap_or(near),
            far: options.far.or(far),
            color_threshold: settings.threshold as f32,
            alpha_threshold: 0.0,
            sampled: None,
            voxel: None,
        },
        background: options.background.or(background).unwrap_or([1.0; 3]),
    }
}
