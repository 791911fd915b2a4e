//! Opens a fog volume as a field.

use std::sync::Arc;

use super::grid::{CLASS, VdbGrid, grid_names, is_scalar, read_class, read_grid};
use super::nodes::{GridValues, NodeBox, White};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::model::field::{Activation, ColorDomain, Grid, March, RadianceField, Scene};
use crate::model::grid::{Bounds, Nodes};
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, Source};
use crate::tensor::{FileKind, GRIDS, TensorFile};

/// The grid of optical depth.
const DENSITY: &str = "density";
/// Names of colour grids; the first match counts.
const COLORS: [&str; 2] = ["Cd", "color"];
/// Step length in voxels.
const STEPSIZE: f32 = 0.5;
/// Grids whose voxels differ by up to this share of a voxel are aligned.
const SAME_PLACE: f64 = 1e-3;

/// True for OpenVDB and NanoVDB files.
pub fn knows(file: &TensorFile) -> bool {
    matches!(file.kind, FileKind::Vdb | FileKind::NanoVdb)
}

/// Opens a fog volume: reads all of its grids.
///
/// # Errors
/// `Unsupported` for files without a grid of density, for grids of other types and classes, and for
/// voxels that are not aligned with the world's axes; `Malformed` and `Truncated` for damaged
/// files.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if let (ViewChoice::Harmonics(_), _) | (_, MlpChoice::File(_)) = (options.view, &options.mlp) {
        return Err(Error::usage(
            "colours of an OpenVDB file do not depend on the view: --view takes keep or none, \
             --mlp auto or none",
        ));
    }
    let grids = grid_names(file);
    let place = Place::Key(GRIDS.to_owned());
    let mut assumptions = Vec::new();
    let name = match &options.grid {
        Some(name) => grid_of(&grids, name)?,
        None => density_name(file, &grids, limits, &mut assumptions)?,
    };
    let mut budget = Budget::new(limits);
    let density = read_grid(file, name, limits, &mut budget)?;
    check_class(&density, name)?;
    let is_empty = density.tree.leaves.is_empty() && density.tree.tiles.is_empty();
    if is_empty && options.grid.is_none() && named(&grids, DENSITY).is_none() {
        return Err(without_density(&grids));
    }
    let (bounds, nodes) = bounds_of(&density, limits, &place)?;
    let color = COLORS.into_iter().find_map(|name| named(&grids, name));
    let color = color.map(|name| read_grid(file, name, limits, &mut budget)).transpose()?;
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
        shells: Vec::new(),
    };
    field.check()?;
    Ok(Source {
        field,
        model: None,
        family: Family::Vdb,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: Vec::new(),
    })
}

/// The exact name of a grid in the file, else a match that ignores case.
fn named<'a>(grids: &[(&'a str, &'a str)], wanted: &str) -> Option<&'a str> {
    let mut names = grids.iter().map(|(name, _)| *name);
    let exact = names.clone().find(|name| *name == wanted);
    exact.or_else(|| names.find(|name| name.eq_ignore_ascii_case(wanted)))
}

/// The grid of a name that the user states.
fn grid_of<'a>(grids: &[(&'a str, &'a str)], name: &str) -> Result<&'a str> {
    let found = grids.iter().find(|(own, _)| *own == name);
    let (own, kind) = found.ok_or_else(|| {
        Error::invalid_option(
            "grid",
            name.to_owned(),
            format!("one of the file's {}", listed(grids)),
        )
    })?;
    if !is_scalar(kind) {
        let expected = "a grid with one number per voxel";
        return Err(Error::invalid_option("grid", format!("{name}, of type {kind}"), expected));
    }
    Ok(own)
}

/// The grid of density: by name, else the only scalar fog volume.
fn density_name<'a>(
    file: &'a TensorFile,
    grids: &[(&'a str, &'a str)],
    limits: &Limits,
    assumptions: &mut Vec<Assumption>,
) -> Result<&'a str> {
    if let Some(name) = named(grids, DENSITY) {
        return Ok(name);
    }
    let mut fogs = Vec::new();
    for (name, _) in grids.iter().filter(|(_, kind)| is_scalar(kind)) {
        if !is_surface(read_class(file, name, limits)?.as_deref()) {
            fogs.push(*name);
        }
    }
    let [name] = fogs.as_slice() else {
        return Err(without_density(grids));
    };
    let name: &'a str = name;
    assumptions.push(Assumption {
        key: "density",
        value: name.to_owned(),
        message: format!(
            "no grid is named density: using the only fog volume, grid {}",
            shown(name)
        ),
    });
    Ok(name)
}

/// The error for a file without a grid of density.
fn without_density(grids: &[(&str, &str)]) -> Error {
    let expected = "a fog volume in a grid named density, or a single fog volume";
    let error = Error::unsupported(Place::Key(GRIDS.to_owned()), listed(grids), expected);
    error.advise("name the grid of density with --grid")
}

/// The names of a file's grids, for messages.
fn listed(grids: &[(&str, &str)]) -> String {
    match grids {
        [] => "no grids".to_owned(),
        grids => {
            let names: Vec<&str> = grids.iter().map(|(name, _)| shown(name)).collect();
            format!("grids {}", names.join(", "))
        }
    }
}

/// A grid's name, for messages.
fn shown(name: &str) -> &str {
    if name.is_empty() { "(unnamed)" } else { name }
}

/// True for classes of grids without densities.
fn is_surface(class: Option<&str>) -> bool {
    matches!(class, Some("level set" | "staggered"))
}

/// Refuses distances and velocities, which only look like densities.
fn check_class(density: &VdbGrid, name: &str) -> Result<()> {
    let Some(class) = density.text(CLASS).filter(|class| is_surface(Some(class))) else {
        return Ok(());
    };
    let place = Place::Key(format!("{GRIDS}.{name}"));
    let found = format!("a grid of class {class:?}, whose numbers are not densities");
    let error = Error::unsupported(place, found, "a fog volume");
    Err(error
        .advise("convert it to a fog volume (Houdini's Convert VDB, OpenVDB's sdfToFogVolume)"))
}

/// The box of a grid's active voxels and a border, and its nodes. Without voxels, the box from
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
    bounds.check_model(place)?;
    Ok((bounds, nodes))
}

/// Refuses grids that are not aligned.
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
            let (own, other) = (own.describe(), other.describe());
            let found = format!("density voxels of {own}, and colour voxels of {other}");
            let expected = "the same voxels for both";
            Err(Error::unsupported(place.clone(), found, expected)
                .advise("resample one of the grids to the voxels of the other, and save the file"))
        }
    }
}
