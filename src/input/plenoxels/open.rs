//! Opens a file of Plenoxels as a field, and as a model with its own rules.

use std::sync::Arc;

use super::arguments::{ArgumentsFile, RunArguments};
use super::keys::Arrays;
use super::model::PlenoxelsFile;
use crate::base::error::{Place, Result};
use crate::base::limits::Limits;
use crate::input::checkpoint::{Assumption, Companion, Family, Source, SourceOptions, ViewChoice};
use crate::input::sparse::{Channel, RowGrid};
use crate::input::tensor::{FileKind, TensorFile};
use crate::model::field::{
    Activation, ColorDomain, FreeSpace, Grid, Lookup, March, RadianceField, Scene,
};
use crate::model::grid::{Bounds, Nodes};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;

/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;

/// Opens a file of Plenoxels. Rows and links stay in the file.
///
/// # Errors
/// `Unsupported` for other bases, scenes in normalised device coordinates, renderers that do not
/// interpolate, and backgrounds; `Malformed` where arrays are missing or do not fit.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let arrays = Arrays::find(file, options.drop_background, limits)?;
    let beside = ArgumentsFile::beside(file.file.path(), limits)?;
    let mut assumptions = Vec::new();
    let (mut companions, mut recorded) = (Vec::new(), Vec::new());
    let mut run = RunArguments::default();
    match beside {
        Some(ArgumentsFile { path, digest, arguments }) => {
            companions.push(Companion { role: "args", path, digest });
            recorded = vec!["stepsize", "near", "background"];
            run = arguments;
        }
        None if options.stepsize.is_none() || options.background.is_none() => {
            assumptions.push(Assumption {
                key: "args",
                value: "defaults".to_owned(),
                message: "no args.json of the training lies beside the file: assuming steps of 0.5 \
                          voxels, a white background and the scene's own scale; options stepsize, \
                          background and scene-scale set them"
                    .to_owned(),
            });
        }
        None => {}
    }
    if options.drop_background && file.root.get("background_data").is_some() {
        assumptions.push(Assumption {
            key: "background_data",
            value: "none".to_owned(),
            message: "option drop-background: the spheres behind the box are left out".to_owned(),
        });
    }
    run.step_size = options.stepsize.map_or(run.step_size, f64::from);
    let (scene, free_space) = scene(&arrays, &run, options)?;
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
        ViewChoice::None => (Channel::of_band_0(color, stored, harmonics), None),
        _ => (
            Channel::of_harmonics(color, stored, harmonics.functions()),
            Some(ViewDependence::Harmonics(harmonics)),
        ),
    };
    let covered = file.kind != FileKind::Safetensors;
    let grid = |array, channels| {
        Grid::Values(Arc::new(RowGrid::new(&arrays.index, array, channels, 1, covered)))
    };
    let field = RadianceField {
        scene,
        density: grid(&arrays.density, vec![Channel::Column(density)]),
        color: vec![grid(&arrays.color, channels)],
        color_domain: ColorDomain::Linear,
        view,
        free_space: Some(free_space),
    };
    field.check()?;
    #[expect(clippy::cast_possible_truncation, reason = "settings are float32")]
    let scene_scale = run.scene_scale.map_or(1.0, |scale| scale as f32);
    Ok(Source {
        field,
        model: Some(Arc::new(PlenoxelsFile { arrays, run, harmonics })),
        family: Family::Plenoxels,
        kind: file.kind,
        scene_scale,
        assumptions,
        recorded,
        digest: file.digest,
        file: Arc::clone(&file.file),
        companions,
    })
}

/// The scene of a field with a node more beyond each face, and the mask that cuts at the faces of
/// the cells.
#[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
fn scene(
    arrays: &Arrays,
    run: &RunArguments,
    options: &SourceOptions,
) -> Result<(Scene, FreeSpace)> {
    let Nodes(cells) = arrays.index.nodes();
    let Arrays { radius, center, .. } = arrays;
    let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
    let (mut scale, mut shift) = ([0.0; 3], [0.0; 3]);
    let mut volume = 1.0;
    let corners = bounds.min.iter_mut().zip(&mut bounds.max);
    let mapped = scale.iter_mut().zip(&mut shift);
    for (((min, max), (scale, shift)), ((radius, center), count)) in
        corners.zip(mapped).zip(radius.iter().zip(center).zip(cells))
    {
        let reach = radius * (1.0 + 1.0 / count as f64);
        (*min, *max) = ((center - reach) as f32, (center + reach) as f32);
        // The mask's two middle nodes reach from face to face of the cells.
        *scale = 1.0 / radius;
        *shift = 1.5 - center / radius;
        volume *= 2.0 * radius / count as f64;
    }
    bounds.check(&Place::Tensor("radius".to_owned()))?;
    let voxel_size = libm::cbrt(volume) as f32;
    let stepsize = run.step_size as f32;
    let march = March {
        stepsize,
        voxel_size,
        near: run.near_clip as f32,
        far: None,
        color_threshold: options.color_threshold.unwrap_or(0.0),
        alpha_threshold: 0.0,
    };
    let scene = Scene {
        bounds,
        nodes: Nodes(cells.map(|size| size + 2)),
        activation: Activation::relu(stepsize * voxel_size),
        march,
        background: options.background.unwrap_or([run.background_brightness as f32; 3]),
    };
    Ok((scene, FreeSpace { nodes: Nodes([4; 3]), scale, shift, lookup: middle() }))
}

/// A mask of 4 x 4 x 4 nodes of which the middle ones are inside.
fn middle() -> Lookup {
    let is_inside = |node: &usize| (1..3).contains(node);
    let nodes = (0..64usize).map(|at| [at / 16, at / 4 % 4, at % 4].iter().all(is_inside));
    Lookup::Nearest(nodes.collect())
}
