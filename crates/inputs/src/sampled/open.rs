//! Opens a file of sampled arrays as a field, and as a model with its own rules.

use std::sync::Arc;

use super::keys::{Arrays, number, numbers};
use super::model::SampledFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::field::{
    Activation, ColorDomain, Grid, Lattice, March, RadianceField, Scene, Shell,
};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::trained_model::LoadModel;
use crate::model::view_dependence::ViewDependence;
use crate::options::{SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, Source};
use crate::sparse::{Channel, RowGrid};
use crate::tensor::{TensorFile, Value};

/// Plain colours go up to 1, or slightly beyond after interpolation.
const BRIGHTEST: f32 = 2.0;
/// Step length in voxels of files that state none.
const STEPSIZE: f32 = 0.5;

/// Opens a file of sampled arrays. Values stay in the file.
///
/// # Errors
/// `Malformed` if arrays are missing or do not fit.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let (mut arrays, mut around) = Arrays::find_all(file, limits)?;
    if options.drop_background {
        around.clear();
    }
    let stored = arrays.harmonics.map_or(1, |rules| rules.functions());
    if let Some(rules) = &mut arrays.harmonics {
        match options.view {
            ViewChoice::Keep => {}
            ViewChoice::Harmonics(most) => rules.degree = rules.degree.min(most),
            ViewChoice::None => rules.degree = 0,
        }
    }
    let (channels, view) = match (arrays.harmonics, options.view) {
        (None, _) => ((0..3).map(Channel::column).collect(), None),
        (Some(rules), ViewChoice::None) => {
            (Channel::of_band_0(Channel::of_harmonics(0, stored, 1), rules), None)
        }
        (Some(rules), _) => {
            // The sum of clamped samples equals the clamped sum if no sample is clamped; this does
            // not hold for a sigmoid.
            let evaluation = match rules.clamp {
                Clamp::Zero | Clamp::None => Evaluation::Ray,
                Clamp::Sigmoid => Evaluation::Sample,
            };
            let field = Harmonics { evaluation, ..rules };
            let channels = Channel::of_harmonics(0, stored, rules.functions());
            (channels, Some(ViewDependence::Harmonics(field)))
        }
    };
    let has_checksums = file.has_checksums;
    let grids = |arrays: &Arrays| {
        let unchecked = match has_checksums {
            true => Vec::new(),
            false => vec![Arc::clone(&arrays.density), Arc::clone(&arrays.color)],
        };
        let grid = |array, channels| {
            let index = &arrays.index;
            Grid::Values(Arc::new(RowGrid::new(index, array, channels, 0, unchecked.clone())))
        };
        let density = grid(&arrays.density, vec![Channel::column(0)]);
        (density, vec![grid(&arrays.color, channels.clone())])
    };
    let shell = |arrays: &Arrays| {
        let (lattice, (density, color)) =
            (Lattice::new(arrays.bounds, arrays.index.nodes()), grids(arrays));
        Shell { lattice, density, color }
    };
    let shells: Vec<Shell> = around.iter().map(shell).collect();
    let (density, color) = grids(&arrays);
    let assumptions = match arrays.harmonics {
        None => bright_colors(file)?.into_iter().collect(),
        Some(_) => Vec::new(),
    };
    let (scene, recorded) = scene(file, &arrays, options)?;
    let field = RadianceField {
        density,
        color,
        color_domain: ColorDomain::Linear,
        view,
        free_space: None,
        shells,
        scene,
    };
    field.check()?;
    let step = field.scene.march.interval_length();
    // Nested boxes have no rules but those of a field.
    let model: Option<Arc<dyn LoadModel>> = match field.shells.is_empty() {
        true => Some(Arc::new(SampledFile { arrays, stored, step })),
        false => None,
    };
    Ok(Source {
        field,
        model,
        family: Family::Sampled,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        scene_scale: 1.0,
        assumptions,
        recorded,
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: Vec::new(),
    })
}

/// The treatment of plain colours far beyond white.
fn bright_colors(file: &TensorFile) -> Result<Option<Assumption>> {
    let Some(tensor) = file.root.get("color").and_then(Value::tensor) else { return Ok(None) };
    let colors = tensor.glance()?.into_iter().filter(|value| value.is_finite());
    let most = colors.fold(0.0, f32::max);
    Ok((most > BRIGHTEST).then(|| Assumption {
        key: "color",
        value: most.to_string(),
        message: format!(
            "color goes up to {most} or more, expected 0 to 1: taken as it is, which looks white; \
             divide it by 255 if it counts from 0 to 255"
        ),
    }))
}

/// The scene, and the names of settings that the file states.
#[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
fn scene(
    file: &TensorFile,
    arrays: &Arrays,
    options: &SourceOptions,
) -> Result<(Scene, Vec<&'static str>)> {
    let (bounds, nodes) = (arrays.bounds, arrays.index.nodes());
    let spacing = nodes.spacing(&bounds);
    let voxel_size = libm::cbrt(spacing.into_iter().product()) as f32;
    let own_step = number(file, "stepsize")?;
    let own_background = numbers(file, "background")?;
    let background = match own_background.as_deref() {
        None => None,
        Some(&[red, green, blue]) => Some([red, green, blue].map(|value| value as f32)),
        Some(&[grey]) => Some([grey as f32; 3]),
        Some(found) => {
            let place = Place::Key("background".to_owned());
            return Err(Error::malformed(place, format!("{found:?}"), "three numbers"));
        }
    };
    let stated = SourceOptions { stepsize: own_step, background, ..SourceOptions::default() };
    stated.check().map_err(|error| {
        let expected = "valid settings of a scene";
        Error::malformed(Place::File, error.kind().to_string(), expected)
    })?;
    let stepsize = options.stepsize.or(own_step).unwrap_or(STEPSIZE);
    let color_threshold = options.color_threshold.unwrap_or(0.0);
    let march = March { color_threshold, ..March::new(stepsize, voxel_size) };
    let scene = Scene {
        bounds,
        nodes,
        activation: Activation::relu(stepsize * voxel_size),
        march,
        background: options.background.or(background).unwrap_or([1.0; 3]),
    };
    let settings = [("stepsize", own_step.is_some()), ("background", background.is_some())];
    let recorded = settings.into_iter().filter(|(_, stated)| *stated).map(|(name, _)| name);
    Ok((scene, recorded.collect()))
}
