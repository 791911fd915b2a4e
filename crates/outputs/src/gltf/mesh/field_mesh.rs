//! The mesh of a container.

use super::opacity_grid::OpacityGrid;
use super::triangles::{Mesh, TriangleSoup};
use super::{appearance, simplify, surface};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::base::parallel;
use crate::container::Container;

/// Nodes along the longest axis that a surface is made of, at most; finer levels are averaged.
const MAX_NODES: usize = 128;

/// The fewest triangles of a closed surface.
pub const FEWEST_TRIANGLES: usize = 4;

/// The mesh of a field, of at most `triangles` triangles (but 12 for an empty field), and up to
/// `coarser` others, each of a quarter of the triangles of the one before.
///
/// # Errors
/// Fewer than [`FEWEST_TRIANGLES`]; a container that cannot be read.
pub fn meshes(container: &Container, triangles: usize, coarser: usize) -> Result<Vec<Mesh>> {
    if triangles < FEWEST_TRIANGLES {
        let expected = format!("at least {FEWEST_TRIANGLES}");
        return Err(Error::invalid_option("fallback_triangles", triangles.to_string(), expected));
    }
    let metadata = container.metadata();
    let (_, free_space) = container.read_head()?;
    let own = |level: &usize| metadata.levels.get(*level).is_some_and(|l| l.density.is_some());
    let mut best = TriangleSoup::default();
    let mut cell = 0.0;
    // Of nested boxes the mesh shows the innermost: coarser levels span others.
    let count = if metadata.shells.is_empty() { metadata.levels.len() } else { 2 };
    for level in (0..count.min(metadata.levels.len())).rev().filter(own) {
        // Each thread holds a plane of density and three of colour.
        let [_, ny, nz] = metadata.levels[level].dimensions.map(|size| size as u64);
        let planes = 16 * parallel::threads() as u64 * ny * nz;
        Budget::new(container.limits()).spend(planes, "bytes of planes", &Place::File)?;
        let codes = container.read_level(level)?;
        let grid = OpacityGrid::of_level(metadata, level, &codes, free_space.as_ref(), MAX_NODES)?;
        (best, cell) = (surface::surface(&grid), grid.cell);
        if best.triangles.len() >= triangles || grid.averaged {
            break;
        }
    }
    let field = appearance::renderer(container)?;
    let mut soup = simplify::simplify(best, triangles, cell);
    let mut meshes = Vec::new();
    while !soup.triangles.is_empty() {
        appearance::color(&mut soup, &field, cell)?;
        meshes.extend(Some(Mesh::of_soup(&soup)).filter(|mesh| !mesh.triangles.is_empty()));
        let fewer = soup.triangles.len() / 4;
        if meshes.len() > coarser || fewer < FEWEST_TRIANGLES {
            break;
        }
        let before = soup.triangles.len();
        soup = simplify::simplify(soup, fewer, cell);
        if soup.triangles.len() == before {
            break;
        }
    }
    if meshes.is_empty() {
        meshes.push(Mesh::of_box(&metadata.bounds));
    }
    Ok(meshes)
}
