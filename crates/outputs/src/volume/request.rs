//! The volume for the options.

use super::sparse::{SparseVolume, VolumeOptions, level_nodes};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::format::{ExportOptions, ExportSource};
use crate::model::grid::{Bounds, Nodes};
use crate::view::Lattice;

/// The largest number of points between two nodes.
const MOST_POINTS: usize = 16;
/// Cells along the longest axis, at least.
const FEWEST_CELLS: usize = 2;

/// The points of a volume: nodes times `--supersample`, `factor` without it, or cubes.
///
/// # Errors
///
/// Options out of range, and more points than the limits allow.
pub fn lattice(source: &ExportSource, options: &ExportOptions, factor: usize) -> Result<Lattice> {
    let nodes = Nodes(level_nodes(&source.field, options.level));
    lattice_of(&source.field.view().bounds, nodes, options, factor)
}

/// The same of a box with other nodes.
///
/// # Errors
///
/// As [`lattice`].
pub fn lattice_of(
    bounds: &Bounds,
    nodes: Nodes,
    options: &ExportOptions,
    factor: usize,
) -> Result<Lattice> {
    let limits = &options.limits;
    let factor = options.supersample.unwrap_or(factor);
    let factors = format!("1 to {MOST_POINTS}");
    Error::require_option((1..=MOST_POINTS).contains(&factor), "supersample", factor, &factors)?;
    match options.resolution {
        Some(cells) => {
            let expected = "2 cells or more";
            Error::require_option(cells >= FEWEST_CELLS, "resolution", cells, expected)?;
            Lattice::of_cubes(bounds, cells, limits)
        }
        None => Lattice::of_nodes(bounds, nodes, factor, limits),
    }
}

/// The volume at the points of a lattice, and `beyond` it colours.
///
/// # Errors
///
/// As [`SparseVolume::new`].
pub fn volume(
    source: &ExportSource,
    options: &ExportOptions,
    lattice: Lattice,
    beyond: bool,
    progress: &dyn Progress,
) -> Result<SparseVolume> {
    let wanted = VolumeOptions { level: options.level, features: options.features, beyond };
    SparseVolume::new(&source.field, lattice, wanted, &options.limits, progress)
}

/// Content of a source that no volume format can represent.
pub fn lost(source: &ExportSource, options: &ExportOptions) -> Vec<String> {
    let view = source.field.view();
    let mut lost = Vec::new();
    if view.view_dependence.is_some() || source.field.is_model() {
        lost.push("view-dependent colour: voxels have their mean colour".to_owned());
    }
    if source.field.levels() > 1 {
        lost.push("other levels".to_owned());
    }
    if !source.field.is_model() {
        let option = if options.resolution.is_some() { "resolution" } else { "supersample" };
        lost.push(format!("sharpness: surfaces are softer; a higher --{option} helps"));
    }
    lost.push("blending: programs blend in linear light, the field was trained in sRGB".to_owned());
    lost
}
