//! Reading written files back, by the reader of inputs.

use std::collections::HashMap;

use crate::base::error::{Error, Result};
use crate::base::limits::{Budget, Limits};
use crate::export_files::WrittenFiles;
use crate::volume::{Extinction, POINTS, SIDE, VolumePoints};
use mipvog_inputs::tensor::{self, Value};
use mipvog_inputs::vdb::{Tree, VdbGrid, read_grid};

/// The grids of density and colour, rotated to a world with z up.
///
/// # Errors
/// Errors of reading.
pub fn read_points(files: &WrittenFiles, limits: &Limits) -> Result<[VdbGrid; 2]> {
    let file = tensor::open_file(&files.with_extension("vdb")?, limits)?;
    let mut budget = Budget::new(limits);
    let is_turned = matches!(file.root.get("mipvog_up"), Some(Value::Text(up)) if up == "y");
    let mut grids = Vec::new();
    for name in ["density", "Cd"] {
        let mut grid = read_grid(&file, name, limits, &mut budget)?;
        if is_turned {
            grid.placed = grid.placed.with_z_up();
        }
        grids.push(grid);
    }
    <[VdbGrid; 2]>::try_from(grids).map_err(|_| Error::usage("two grids were read"))
}

/// The points of both grids.
///
/// # Errors
/// More memory than the limits allow.
pub fn points_of([density, color]: [VdbGrid; 2], limits: &Limits) -> Result<VolumePoints> {
    let scale = density.number("mipvog_density_scale").unwrap_or(1.0);
    let mut budget = Budget::new(limits);
    let mut leaves: HashMap<[i32; 3], Vec<[f32; 4]>> = HashMap::new();
    let mut add = |tree: &Tree, put: &dyn Fn(&mut [f32; 4], &[f32])| -> Result<()> {
        for leaf in &tree.leaves {
            let bytes = (POINTS * size_of::<[f32; 4]>()) as u64;
            budget.spend(bytes, "bytes of a volume", &crate::base::error::Place::File)?;
            let width = leaf.values.len() / POINTS;
            let at = leaf.origin.map(|at| at.div_euclid(SIDE as i32));
            let points = leaves.entry(at).or_insert_with(|| vec![[0.0; 4]; POINTS]);
            for (point, value) in points.iter_mut().zip(leaf.values.chunks_exact(width)) {
                put(point, value);
            }
        }
        Ok(())
    };
    add(&density.tree, &|point, value| point[0] = value[0] * scale)?;
    add(&color.tree, &|point, value| point[1..].copy_from_slice(value))?;
    // The writer's voxels run along the world's axes.
    let (first, spacing) = (density.placed.first, density.placed.spacing());
    Ok(VolumePoints { first, spacing, extinction: Extinction::Density, faces: None, leaves })
}
