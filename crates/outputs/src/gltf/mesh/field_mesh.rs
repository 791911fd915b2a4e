//! The mesh of a container.

use super::opacity_grid::OpacityGrid;
use super::triangles::{Mesh, TriangleSoup};
use super::{appearance, simplify, surface};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::base::parallel;
use crate::container::Container;

/// Maximum nodes along the longest axis for a surface; finer levels are averaged.
const MAX_NODES: usize = 128;

/// The fewest triangles of a closed surface.
pub const FEWEST_TRIANGLES: usize = 4;

/// The mesh of a field, of at most `triangles` triangles (12 for an empty field), and up to
/// `coarser` others, each with a quarter of the triangles of the one before. Of nested boxes, the
/// innermost gets half of the triangles, and the others share the rest.
///
/// # Errors
/// Fewer than [`FEWEST_TRIANGLES`]; a container that cannot be read.
pub fn meshes(container: &Container, triangles: usize, coarser: usize) -> Result<Vec<Mesh>> {
    if triangles < FEWEST_TRIANGLES {
        let expected = format!("at least {FEWEST_TRIANGLES}");
        return Err(Error::invalid_option("fallback_triangles", triangles.to_string(), expected));
    }
    let metadata = container.metadata();
    let mut field = appearance::renderer(container)?;
    let mut parts = parts(container, triangles)?;
    let mut meshes = Vec::new();
    let mut count = triangles;
    while parts.iter().any(|part| !part.soup.triangles.is_empty()) {
        let mut soup = TriangleSoup::default();
        for part in &mut parts {
            appearance::color(&mut part.soup, &mut field, part.cell)?;
            soup.add(&part.soup);
        }
        meshes.extend(Some(Mesh::of_soup(&soup)).filter(|mesh| !mesh.triangles.is_empty()));
        let before = soup.triangles.len();
        count = count.min(before) / 4;
        if meshes.len() > coarser || count < FEWEST_TRIANGLES {
            break;
        }
        let shares = shares(count, parts.len());
        for (part, share) in parts.iter_mut().zip(shares) {
            let soup = std::mem::take(&mut part.soup);
            part.soup = simplify::simplify(soup, share, part.cell);
        }
        if parts.iter().map(|part| part.soup.triangles.len()).sum::<usize>() == before {
            break;
        }
    }
    if meshes.is_empty() {
        meshes.push(Mesh::of_box(&metadata.bounds));
    }
    Ok(meshes)
}

/// The surface of a box.
struct Part {
    soup: TriangleSoup,
    /// The edge of a cell of its grid, in world units.
    cell: f64,
}

/// Triangles of each of several boxes, the innermost first.
fn shares(triangles: usize, boxes: usize) -> Vec<usize> {
    let around = boxes - 1;
    let inner = if around == 0 { triangles } else { triangles / 2 };
    let share = (triangles - inner).checked_div(around).unwrap_or(0);
    [inner].into_iter().chain(std::iter::repeat_n(share, around)).collect()
}

/// The simplified surfaces of all boxes, the innermost first.
fn parts(container: &Container, triangles: usize) -> Result<Vec<Part>> {
    let metadata = container.metadata();
    let shares = shares(triangles, metadata.shells.len() + 1);
    let inner = inner(container, shares[0])?;
    let mut parts = vec![inner];
    if !metadata.shells.is_empty() {
        let boxes = metadata.boxes();
        let field = container.read()?;
        for (number, share) in shares.into_iter().enumerate().skip(1) {
            let own = field.clone().one_box(number);
            let (hollow, level) = (&boxes[number - 1], &own.levels[0]);
            let grid =
                OpacityGrid::of_level(&own.metadata, 0, level, None, Some(hollow), MAX_NODES)?;
            let mut soup = surface::surface(&grid);
            soup.drop_within(hollow);
            parts.push(Part { soup: simplify::simplify(soup, share, grid.cell), cell: grid.cell });
        }
    }
    Ok(parts)
}

/// The surface of the innermost box, from the coarsest level with enough triangles.
fn inner(container: &Container, triangles: usize) -> Result<Part> {
    let metadata = container.metadata();
    let (_, free_space) = container.read_head()?;
    let own = |level: &usize| metadata.levels.get(*level).is_some_and(|l| l.density.is_some());
    let mut best = TriangleSoup::default();
    let mut cell = 0.0;
    // Coarser levels of nested boxes span outer boxes.
    let count = if metadata.shells.is_empty() { metadata.levels.len() } else { 2 };
    for level in (0..count.min(metadata.levels.len())).rev().filter(own) {
        // Each thread holds a plane of density and three of colour.
        let [_, ny, nz] = metadata.levels[level].dimensions.map(|size| size as u64);
        let planes = 16 * parallel::threads() as u64 * ny * nz;
        Budget::new(container.limits()).spend(planes, "bytes of planes", &Place::File)?;
        let codes = container.read_level(level)?;
        let free_space = free_space.as_ref();
        let grid = OpacityGrid::of_level(metadata, level, &codes, free_space, None, MAX_NODES)?;
        (best, cell) = (surface::surface(&grid), grid.cell);
        if best.triangles.len() >= triangles || grid.averaged {
            break;
        }
    }
    Ok(Part { soup: simplify::simplify(best, triangles, cell), cell })
}
