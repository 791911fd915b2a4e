//! Opens a fog volume as a field.

use std::sync::Arc;

use super::grid::{VdbGrid, grid_names, read_grid};
use super::nodes::{GridValues, NodeBox, White};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::input::source::{Assumption, Family, Source};
use crate::input::tensor::{FileKind, GRIDS, TensorFile};
use crate::model::field::{Activation, ColorDomain, Grid, March, RadianceField, Scene};
use crate::model::grid::{Bounds, Nodes};

/// The grid of optical depth.
const DENSITY: &str = "density";
/// Grids of colour, the first of which counts.
const COLORS: [&str; 2] = ["Cd", "color"];
/// Step length in voxels.
const STEPSIZE: f32 = 0.5;
/// Grids whose voxels are this much of a voxel apart are in one place.
const SAME_PLACE: f64 = 1e-3;

/// True for OpenVDB files.
pub fn knows(file: &TensorFile) -> bool {
    file.kind == FileKind::Vdb
}

/// Opens a fog volume: reads all of its grids.
///
/// # Errors
/// `Unsupported` for files without a grid `density`, for grids of other types, and for voxels that
/// are not along the world's axes; `Malformed` and `Truncated` for damaged files.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if let (ViewChoice::Harmonics(_), _) | (_, MlpChoice::File(_)) = (options.view, &options.mlp) {
        return Err(Error::usage(
            "colours of an OpenVDB file do not depend on the view: --view takes keep or none, \
             --mlp auto or none",
        ));
    }
    let grids = grid_names(file);
    let has = |name: &str| grids.iter().any(|(own, _)| *own == name);
    let place = Place::Key(GRIDS.to_owned());
    if !has(DENSITY) {
        let names: Vec<&str> = grids.iter().map(|(name, _)| *name).collect();
        let found = format!("grids {names:?}");
        return Err(Error::unsupported(place, found, "a fog volume with a grid named density"));
    }
    let mut budget = Budget::new(limits);
    let density = read_grid(file, DENSITY, limits, &mut budget)?;
    let (bounds, nodes) = bounds_of(&density, limits, &place)?;
    let color = COLORS.into_iter().find(|name| has(name));
    let color = color.map(|name| read_grid(file, name, limits, &mut budget)).transpose()?;
    let mut assumptions = Vec::new();
    let color = match color {
        Some(color) => {
            check_places(&density, &color, &place)?;
            let values = GridValues::new(color, nodes, true, limits, &mut budget)?;
            Grid::Values(Arc::new(values))
        }
        None => {
            assumptions.push(Assumption {
                key: "color",
                value: "white".to_owned(),
                message: "the file has no grid Cd or color: assuming white".to_owned(),
            });
            Grid::Values(Arc::new(White(nodes)))
        }
    };
    let spacing = density.placed.spacing();
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let voxel_size = libm::cbrt(spacing.into_iter().product()) as f32;
    let stepsize = options.stepsize.unwrap_or(STEPSIZE);
    let near = options.near.unwrap_or(0.0);
    let color_threshold = options.color_threshold.unwrap_or(0.0);
    let march =
        March { near, far: options.far, color_threshold, ..March::new(stepsize, voxel_size) };
    let activation = Activation::relu(stepsize * voxel_size);
    let background = options.background.unwrap_or([1.0; 3]);
    let scene = Scene { bounds, nodes: nodes.nodes, activation, march, background };
    let density = GridValues::new(density, nodes, false, limits, &mut budget)?;
    let field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(density)),
        color: vec![color],
        color_domain: ColorDomain::Linear,
        view: None,
        free_space: None,
    };
    field.check()?;
    Ok(Source {
        field,
        model: None,
        family: Family::Vdb,
        kind: file.kind,
        has_checksums: file.has_checksums,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        companions: Vec::new(),
    })
}

/// The box of a grid's active voxels and a border, and its nodes. Without voxels it is the box from
/// voxel 0 to voxel 1.
fn bounds_of(grid: &VdbGrid, limits: &Limits, place: &Place) -> Result<(Bounds, NodeBox)> {
    let nodes = NodeBox::of(grid, limits, place)?;
    let nodes = nodes.unwrap_or(NodeBox { low: [0; 3], nodes: Nodes([2; 3]) });
    let (mut bounds, spacing) = (Bounds { min: [0.0; 3], max: [0.0; 3] }, grid.placed.spacing());
    let corners = bounds.min.iter_mut().zip(&mut bounds.max);
    let along = nodes.low.into_iter().zip(nodes.nodes.0).zip(spacing).zip(grid.placed.first);
    for ((min, max), (((low, count), spacing), first)) in corners.zip(along) {
        let low = first + f64::from(low) * spacing;
        #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
        {
            *min = low as f32;
            *max = (low + (count - 1) as f64 * spacing) as f32;
        }
    }
    bounds.check(place)?;
    Ok((bounds, nodes))
}

/// Refuses grids whose voxels are elsewhere.
fn check_places(density: &VdbGrid, color: &VdbGrid, place: &Place) -> Result<()> {
    let (own, other) = (&density.placed, &color.placed);
    let apart = own.step.into_iter().zip(other.step).zip(own.first.into_iter().zip(other.first));
    let near = |((step, other), (first, other_first)): ((f64, f64), (f64, f64))| {
        let allowed = SAME_PLACE * step.abs();
        (step - other).abs() <= allowed && (first - other_first).abs() <= allowed
    };
    match own.axis == other.axis && apart.into_iter().all(near) {
        true => Ok(()),
        false => {
            let found = format!("voxels of density at {own:?} and of colour at {other:?}");
            let expected = "the same voxels: resample one of the grids";
            Err(Error::unsupported(place.clone(), found, expected))
        }
    }
}
