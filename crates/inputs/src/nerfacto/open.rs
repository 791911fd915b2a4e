//! Opens a model as a field, and as a model with its own rules.

use std::sync::Arc;

use super::file::{Appearance, NerfactoFile};
use super::keys::Keys;
use super::model::{Unloaded, behind};
use super::settings::{self, Background};
use super::space::Space;
use super::world::NerfactoWorld;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::lazy::Lazy;
use crate::model::field::{Activation, ColorDomain, Grid, Lattice, March, RadianceField, Scene};
use crate::model::grid::{Bounds, Nodes};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::nested::{self, Colors, Middle, SampledDensity};
use crate::network::fit_assumption;
use crate::options::{AppearanceChoice, MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, Source};
use crate::tensor::TensorFile;

/// Default nodes along an edge of the first box.
const RESOLUTION: usize = 256;
/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// Default degree of a fit.
const DEGREE: usize = 2;
/// Weight up to which samples add no colour.
const COLOR_THRESHOLD: f32 = 1e-4;
/// Step length of a bake in voxels.
const STEP: f32 = 0.5;

/// True for checkpoints of nerfacto.
pub fn knows(file: &TensorFile) -> bool {
    Keys(file).known()
}

/// Opens a checkpoint of nerfacto.
///
/// # Errors
/// `Unsupported` for other methods of the same arrays, `Malformed` if arrays do not follow each
/// other, `InvalidOption` for an appearance that the model does not have.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if let MlpChoice::File(_) = options.mlp {
        let message =
            "--mlp needs a network that runs once per ray, but this model's runs at every sample";
        return Err(Error::usage(message));
    }
    let keys = Keys(file);
    let mut found = settings::find(file.file.path(), keys.proposals(), limits)?;
    let arrays = keys.arrays(&found.settings)?;
    let pictures = arrays.appearances.as_ref().map_or(0, |(_, [pictures, _])| *pictures);
    let appearance = appearance(options.appearance, pictures, found.settings.mean_appearance)?;
    if let Some(color) = options.background {
        found.settings.background = Background::Color(color);
    }
    let is_whole = found.settings.contracted && !options.drop_background;
    let space = match found.settings.contracted {
        true => Space::Contracted,
        false => Space::Box(arrays.corners),
    };
    let settings = found.settings;
    let model = Arc::new(NerfactoFile {
        arrays,
        settings,
        space,
        appearance,
        limits: limits.clone(),
        loaded: Lazy::default(),
    });
    let lattices = plan(&model, is_whole, options, limits)?;
    let world = Arc::new(NerfactoWorld(Arc::clone(&model)));
    let degree = match options.view {
        ViewChoice::Harmonics(wanted) => wanted.min(Harmonics::MAX_DEGREE),
        _ => DEGREE,
    };
    let (evaluation, clamp) = (Evaluation::Ray, Clamp::Zero);
    let harmonics = Harmonics { degree, evaluation, offset: OFFSET, clamp };
    let plain = options.view == ViewChoice::None || options.mlp == MlpChoice::None;
    let colors = Colors { harmonics, plain, cameras: &options.cameras };
    let background = match model.settings.background {
        Background::Color(color) => color,
        Background::LastSample => behind(&model)?,
    };
    let field = field(&world, &lattices, background, options, &colors, limits)?;
    let mut assumptions: Vec<Assumption> = found.assumption.into_iter().collect();
    if model.settings.background == Background::LastSample {
        assumptions.push(background_assumption(background));
    }
    if !plain {
        assumptions.push(fit_assumption(degree, false, &options.cameras));
    }
    Ok(Source {
        field,
        model: Some(Arc::new(Unloaded(model))),
        family: Family::Nerfacto,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: is_whole,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: found.file.into_iter().collect(),
    })
}

/// The treatment of rays that are extended by their last sample.
fn background_assumption(background: [f32; 3]) -> Assumption {
    let [red, green, blue] = background;
    let value = format!("{red:.3},{green:.3},{blue:.3}");
    let message = format!(
        "beyond its last sample, a ray of this model keeps that sample's colour; a bake has a single \
         background: assuming the mean, {value}; option background sets another one, also for \
         pictures of the unbaked model"
    );
    Assumption { key: "background", value, message }
}

/// The appearance for colours.
fn appearance(choice: AppearanceChoice, pictures: usize, takes_mean: bool) -> Result<Appearance> {
    let refuse =
        |found: String, expected: String| Err(Error::invalid_option("appearance", found, expected));
    match choice {
        AppearanceChoice::Picture(number) if number >= pictures && pictures > 0 => {
            refuse(number.to_string(), format!("mean, zero, or 0 to {}", pictures - 1))
        }
        AppearanceChoice::Mean | AppearanceChoice::Picture(_) if pictures == 0 => {
            refuse("an appearance".to_owned(), "none: this model has no appearances".to_owned())
        }
        AppearanceChoice::Picture(number) => Ok(Appearance::Picture(number)),
        AppearanceChoice::Mean => Ok(Appearance::Mean),
        AppearanceChoice::Auto if takes_mean => Ok(Appearance::Mean),
        AppearanceChoice::Auto | AppearanceChoice::Zero => Ok(Appearance::Zero),
    }
}

/// The boxes: of contracted space around 0, else the scene's own.
fn plan(
    model: &NerfactoFile,
    is_whole: bool,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Vec<Lattice>> {
    let place = Place::Key("aabb".to_owned());
    let nodes = options.resolution.unwrap_or(RESOLUTION);
    if let Space::Box([min, max]) = model.space {
        #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
        let [min, max] = [min, max].map(|corner| corner.map(|at| at as f32));
        let bounds = Bounds { min, max };
        bounds.check_model(&place)?;
        let extent = bounds.extent();
        let longest = extent.iter().copied().fold(0.0, f64::max);
        let cells = (nodes.max(2) - 1) as f64;
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        let counts = extent.map(|edge| libm::ceil(edge / longest * cells).max(1.0) as u64 + 1);
        return Ok(vec![Lattice::new(bounds, Nodes::checked(counts, limits, &place)?)]);
    }
    let middle = Middle { center: [0.0; 3], radius: [1.0; 3] };
    let extent = match is_whole {
        true => options.extent.map_or_else(|| reach(model, nodes), f64::from),
        false => 1.0,
    };
    nested::boxes(nested::even(middle, nodes, extent), middle, extent, limits, &place)
}

/// Default reach of the boxes: up to the last cell of contracted space, of the model's finest grid
/// or of the first box.
fn reach(model: &NerfactoFile, nodes: usize) -> f64 {
    let cells = (model.arrays.finest as f64).min(nodes as f64);
    (cells / 4.0).clamp(1.0, model.settings.far.max(1.0))
}

/// The field of boxes.
fn field(
    world: &Arc<NerfactoWorld>,
    lattices: &[Lattice],
    background: [f32; 3],
    options: &SourceOptions,
    colors: &Colors<'_>,
    limits: &Limits,
) -> Result<RadianceField> {
    let first = lattices
        .first()
        .ok_or_else(|| Error::malformed(Place::Key("aabb".to_owned()), "no box", "one or more"))?;
    let voxel = first.nodes.spacing(&first.bounds).into_iter().fold(0.0, f64::max);
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let voxel_size = voxel as f32;
    let stepsize = options.stepsize.unwrap_or(STEP);
    let march = March {
        stepsize,
        voxel_size,
        near: 0.0,
        far: None,
        color_threshold: options.color_threshold.unwrap_or(COLOR_THRESHOLD),
        alpha_threshold: 0.0,
        sampled: None,
        voxel: None,
    };
    let scene = Scene {
        bounds: first.bounds,
        nodes: first.nodes,
        activation: Activation::logits(0.0, stepsize),
        march,
        background,
    };
    scene.march.check(scene.nodes)?;
    let density = SampledDensity::new(Arc::clone(world), *first, &scene, false);
    let mut field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(density)),
        color: Vec::new(),
        color_domain: ColorDomain::Linear,
        view: (!colors.plain).then_some(ViewDependence::Harmonics(colors.harmonics)),
        free_space: None,
        shells: Vec::new(),
    };
    let around = lattices.get(1..).unwrap_or_default();
    field.shells = nested::shells(world, &field, around, first.bounds, colors, limits);
    field.color.push(nested::fitted_colors(world, &field, colors, limits));
    field.check()?;
    Ok(field)
}
