//! Opens a model as a field, and as a model with its own rules.

use std::sync::Arc;

use super::file::NgpFile;
use super::model::Unloaded;
use super::occupancy::Crop;
use super::values::{DensityValues, Samples};
use super::world::NgpWorld;
use super::{snapshot, torch};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::field::{Activation, ColorDomain, Grid, March, RadianceField, Scene, Shell};
use crate::model::grid::Nodes;
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::nested::{self, Colors, Middle};
use crate::network::{FittedColors, fit_assumption};
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, Source};
use crate::tensor::TensorFile;

/// Default nodes along an axis.
const RESOLUTION: usize = 256;
/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// Default degree of a fit.
const DEGREE: usize = 2;
/// Weight up to which samples add no colour.
const COLOR_THRESHOLD: f32 = 1e-4;
/// Distance at which torch-ngp's rays begin (`--min_near`).
const TORCH_NEAR: f32 = 0.2;
/// torch-ngp's default scale of cameras.
const TORCH_SCALE: f32 = 0.33;

/// True for snapshots of Instant-NGP.
pub fn knows_snapshot(file: &TensorFile) -> bool {
    let within = |key: &str| file.root.at(&["snapshot", key]).is_some();
    within("params_binary") && within("density_grid_binary")
}

/// True for checkpoints of torch-ngp.
pub fn knows_checkpoint(file: &TensorFile) -> bool {
    let within = |key: &str| torch::model(file, key).is_some();
    within("encoder.embeddings") && within("encoder.offsets")
}

/// Opens a snapshot of Instant-NGP.
///
/// # Errors
/// `Unsupported` for other configurations, `Malformed` if the number of parameters does not match
/// the configuration.
pub fn open_snapshot(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    let model = snapshot::read(file, options, limits)?;
    source(file, model, Family::InstantNgp, options, limits)
}

/// Opens a checkpoint of torch-ngp.
///
/// # Errors
/// As [`open_snapshot`].
pub fn open_checkpoint(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    let model = torch::read(file, options, limits)?;
    let mut source = source(file, model, Family::TorchNgp, options, limits)?;
    source.scene_scale = TORCH_SCALE;
    if options.scene_scale.is_none() {
        source.assumptions.push(Assumption {
            key: "scene_scale",
            value: TORCH_SCALE.to_string(),
            message: format!(
                "the scale of cameras is not stored: assuming {TORCH_SCALE}, torch-ngp's default; \
                 option scene-scale sets the trained one (0.8 in its examples)"
            ),
        });
    }
    if source.is_unbounded {
        source.assumptions.push(Assumption {
            key: "dt_gamma",
            value: "1/128".to_owned(),
            message: format!(
                "how steps of rays grow is not stored: assuming dt_gamma 1/128 and min_near \
                 {TORCH_NEAR}, torch-ngp's defaults; they only matter for pictures of the file itself"
            ),
        });
    }
    Ok(source)
}

fn source(
    file: &TensorFile,
    model: NgpFile,
    family: Family,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    if let MlpChoice::File(_) = options.mlp {
        let message =
            "--mlp needs a network that runs once per ray, but this model's runs at every sample";
        return Err(Error::usage(message));
    }
    let is_unbounded = model.span > 1.0;
    let side = options.resolution.unwrap_or(RESOLUTION);
    // Nested boxes share every second node.
    let side = if is_unbounded { side.max(3) | 1 } else { side };
    let nodes = Nodes::checked([side as u64; 3], limits, &Place::Key("resolution".to_owned()))?;
    let plain = options.view == ViewChoice::None || options.mlp == MlpChoice::None;
    let degree = match options.view {
        ViewChoice::Harmonics(wanted) => wanted.min(Harmonics::MAX_DEGREE),
        _ => DEGREE,
    };
    let (evaluation, clamp) = (Evaluation::Ray, Clamp::Zero);
    let rules = Harmonics { degree, evaluation, offset: OFFSET, clamp };
    let model = Arc::new(model);
    let bounds = model.frame.bounds();
    bounds.check_model(&Place::Key("scale".to_owned()))?;
    let voxel = 1.0 / (model.frame.scale * (side - 1) as f64);
    let own_step = model.rules.step * (side - 1) as f64;
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let (voxel_size, own_step) = (voxel as f32, own_step as f32);
    let stepsize = options.stepsize.unwrap_or(own_step);
    let march = March {
        stepsize,
        voxel_size,
        // Space closer to torch-ngp's cameras was never trained.
        near: if is_unbounded && family == Family::TorchNgp { TORCH_NEAR } else { 0.0 },
        far: None,
        color_threshold: options.color_threshold.unwrap_or(COLOR_THRESHOLD),
        alpha_threshold: 0.0,
        sampled: model.occupancy.sampled(&model.frame).filter(|_| !is_unbounded),
        voxel: None,
    };
    let scene = Scene {
        bounds,
        nodes,
        activation: Activation::logits(0.0, stepsize),
        march,
        background: options.background.unwrap_or([1.0; 3]),
    };
    let samples = Samples { file: Arc::clone(&model), side };
    let density = DensityValues(samples.clone());
    let mut field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(density)),
        color: Vec::new(),
        color_domain: ColorDomain::Linear,
        view: (!plain).then_some(ViewDependence::Harmonics(rules)),
        free_space: Some(model.occupancy.free_space(&model.frame)),
        shells: Vec::new(),
    };
    if is_unbounded {
        let colors = Colors { harmonics: rules, plain, cameras: &options.cameras };
        field.shells = shells(&model, &field, options, &colors, limits)?;
    }
    let colors = FittedColors::new(samples, rules, field.clone(), &options.cameras, limits);
    let colors = if plain { colors.plain() } else { colors };
    field.color.push(Grid::Values(Arc::new(colors)));
    field.check()?;
    let mut assumptions = assumptions(family, side, (!plain).then_some(degree), &options.cameras);
    assumptions.extend(crop_assumption(model.occupancy.crop()));
    Ok(Source {
        field,
        model: Some(Arc::new(Unloaded(model))),
        family,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: Vec::new(),
    })
}

/// The boxes around the unit cube.
fn shells(
    model: &Arc<NgpFile>,
    field: &RadianceField,
    options: &SourceOptions,
    colors: &Colors<'_>,
    limits: &Limits,
) -> Result<Vec<Shell>> {
    let (first, radius) = (field.lattice(), 0.5 / model.frame.scale);
    let center = model.frame.offset.map(|offset| (0.5 - offset) / model.frame.scale);
    let extent = options.extent.map_or(model.span, f64::from).min(model.span);
    let place = Place::Key("snapshot.nerf.aabb_scale".to_owned());
    let lattices =
        nested::boxes(first, Middle { center, radius: [radius; 3] }, extent, limits, &place)?;
    let world = Arc::new(NgpWorld(Arc::clone(model)));
    let around = lattices.get(1..).unwrap_or_default();
    Ok(nested::shells(&world, field, around, first.bounds, colors, limits))
}

/// The treatment of the box that a snapshot renders.
fn crop_assumption(crop: Crop) -> Option<Assumption> {
    let (value, message) = match crop {
        Crop::None => return None,
        Crop::Box(_) => (
            "kept",
            "the snapshot is cropped to a part of its cube (render_aabb), and so is the result; save it \
             without a crop to get all of it",
        ),
        Crop::LeftOut => (
            "none",
            "the snapshot has a rotated crop (render_aabb_to_local), which is ignored: the whole cube is \
             shown; crop the container instead",
        ),
    };
    Some(Assumption { key: "render_aabb", value: value.to_owned(), message: message.to_owned() })
}

fn assumptions(
    family: Family,
    side: usize,
    degree: Option<usize>,
    cameras: &[[f64; 3]],
) -> Vec<Assumption> {
    let sampled = Assumption {
        key: "resolution",
        value: side.to_string(),
        message: format!(
            "the model has no grid: a bake samples it at {side} nodes along each axis (option \
             resolution)"
        ),
    };
    let experimental = (family == Family::InstantNgp).then(|| Assumption {
        key: "experimental",
        value: family.name().to_owned(),
        message: format!(
            "support for {} is experimental and was not tried with files of the real program: check \
             pictures before you rely on a bake",
            family.name()
        ),
    });
    let fitted = degree.map(|degree| fit_assumption(degree, false, cameras));
    [sampled].into_iter().chain(experimental).chain(fitted).collect()
}
