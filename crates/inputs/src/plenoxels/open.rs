//! Opens a file of Plenoxels as a field, and as a model with its own rules.

use std::sync::Arc;

use super::arguments::{ArgumentsFile, RunArguments};
use super::keys::{find, spheres};
use super::lightning;
use super::model::PlenoxelsFile;
use super::spheres::SphereSpace;
use super::whole::{surround, viewers};
use super::world::WholeFile;
use crate::base::error::{Place, Result};
use crate::base::limits::Limits;
use crate::lazy::Lazy;
use crate::model::field::{Activation, ColorDomain, Grid, March, RadianceField, Scene};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::options::{SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, SideFile, Source};
use crate::sparse::{CellBox, Channel, RowGrid};
use crate::tensor::TensorFile;

/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;

/// Opens a file of Plenoxels. Rows and links stay in the file.
///
/// # Errors
/// `Unsupported` for other bases, scenes in normalised device coordinates and renderers that do not
/// interpolate; `Malformed` if arrays are missing or do not fit.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let arrays = find(file, options, limits)?;
    let beside = ArgumentsFile::beside(file.file.path(), limits)?;
    let mut assumptions = Vec::new();
    let (mut side_files, mut recorded) = (Vec::new(), Vec::new());
    let mut run = RunArguments::default();
    match beside {
        Some(ArgumentsFile { path, digest, arguments }) => {
            side_files.push(SideFile { role: "args", path, digest });
            recorded = vec!["stepsize", "near", "background"];
            if arguments.scene_scale.is_none() && options.scene_scale.is_none() {
                assumptions.push(data_set_scale(&arguments.dataset_type));
            }
            run = arguments;
        }
        None if options.stepsize.is_none() || options.background.is_none() => {
            assumptions.push(Assumption {
                key: "args",
                value: "defaults".to_owned(),
                message: "the training's args.json is not beside the file: assuming steps of 0.5 \
                          voxels, a white background and the scene's own scale; options stepsize, \
                          background and scene-scale set them"
                    .to_owned(),
            });
        }
        None => {}
    }
    let spheres = spheres(file, limits)?;
    if options.drop_background && spheres.is_some() {
        assumptions.push(Assumption {
            key: "background_data",
            value: "none".to_owned(),
            message: "option drop-background: the spheres behind the box are left out".to_owned(),
        });
    }
    if lightning::knows(file) && options.resolution.is_none() {
        let [side, _, _] = arrays.index.nodes().0;
        assumptions.push(Assumption {
            key: "cells",
            value: side.to_string(),
            message: format!(
                "the checkpoint does not state its grid: assuming {side} cells along each axis, \
                 the least power of 2 that holds all of them; option resolution sets them (384 in \
                 some of its configurations)"
            ),
        });
    }
    run.step_size = options.stepsize.map_or(run.step_size, f64::from);
    let scene = scene(&arrays.cells, &run, options)?;
    let degree = arrays.functions.isqrt() - 1;
    let mut harmonics =
        Harmonics { degree, evaluation: Evaluation::Ray, offset: OFFSET, clamp: Clamp::Zero };
    let stored = arrays.functions;
    let [density, color] = arrays.columns;
    match options.view {
        ViewChoice::Keep => {}
        ViewChoice::Harmonics(most) => harmonics.degree = degree.min(most),
        ViewChoice::None => harmonics.degree = 0,
    }
    let (channels, view) = match options.view {
        ViewChoice::None => {
            (Channel::of_band_0(Channel::of_harmonics(color, stored, 1), harmonics), None)
        }
        _ => (
            Channel::of_harmonics(color, stored, harmonics.functions()),
            Some(ViewDependence::Harmonics(harmonics)),
        ),
    };
    // The digest of an archive includes the checksums of all values.
    let unchecked = match file.has_checksums {
        true => Vec::new(),
        false => vec![Arc::clone(&arrays.density), Arc::clone(&arrays.color)],
    };
    let own_rows = |border| {
        let grid = |array, channels| {
            RowGrid::new(&arrays.index, array, channels, border, unchecked.clone())
        };
        let densities = grid(&arrays.density, vec![Channel::column(density)]);
        [densities, grid(&arrays.color, channels.clone())]
    };
    let [densities, colors] = own_rows(CellBox::BORDER);
    let mut field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(densities)),
        color: vec![Grid::Values(Arc::new(colors))],
        color_domain: ColorDomain::Linear,
        view,
        free_space: None,
        shells: Vec::new(),
    };
    field.check()?;
    #[expect(clippy::cast_possible_truncation, reason = "settings are float32")]
    let scene_scale = run.scene_scale.map_or(1.0, |scale| scale as f32);
    let whole = spheres.filter(|_| !options.drop_background).map(|spheres| {
        let CellBox { radius, center, .. } = arrays.cells;
        (spheres, SphereSpace { center, radius: radius.map(f64::abs) })
    });
    let is_unbounded = whole.is_some();
    if let Some((spheres, space)) = &whole {
        let world = WholeFile {
            arrays: arrays.clone(),
            spheres: Arc::clone(spheres),
            space: *space,
            viewers: viewers(space, &options.cameras),
            step_size: run.step_size,
            harmonics,
            plain: options.view == ViewChoice::None,
            resampled: options.resolution.is_some() && !lightning::knows(file),
            limits: limits.clone(),
            loaded: Lazy::default(),
        };
        surround(&mut field, Arc::new(world), options, own_rows, limits)?;
    }
    Ok(Source {
        field,
        model: Some(Arc::new(PlenoxelsFile { arrays, run, harmonics, spheres: whole })),
        family: Family::Plenoxels,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded,
        scene_scale,
        assumptions,
        recorded,
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    })
}

/// The treatment of a run with the scale of its data set.
fn data_set_scale(kind: &str) -> Assumption {
    Assumption {
        key: "scene_scale",
        value: "1".to_owned(),
        message: format!(
            "args.json leaves the scale of cameras to the data set (dataset_type {kind}), and its \
             own is not stored: assuming 1; option scene-scale sets the trained one (0.6667 for \
             NeRF's synthetic scenes)"
        ),
    }
}

/// The scene of the field.
#[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
fn scene(cells: &CellBox, run: &RunArguments, options: &SourceOptions) -> Result<Scene> {
    let (stepsize, voxel_size) = (run.step_size as f32, cells.voxel_size());
    let tensor = |name: &str| Place::Tensor(name.to_owned());
    let march = March {
        near: run.near_clip as f32,
        color_threshold: options.color_threshold.unwrap_or(0.0),
        sampled: Some(cells.faces()),
        voxel: cells.voxel(),
        ..March::new(stepsize, voxel_size)
    };
    Ok(Scene {
        bounds: cells.bounds(["radius", "center"].map(tensor).each_ref())?,
        nodes: cells.nodes(),
        activation: Activation::relu(stepsize * voxel_size),
        march,
        background: options.background.unwrap_or([run.background_brightness as f32; 3]),
    })
}
