//! The field of a model with background spheres: nested boxes.

use std::sync::Arc;

use super::nodes::{own_box, sampled_box};
use super::spheres::{SphereSpace, Viewers, farthest};
use super::world::WholeFile;
use crate::base::error::{Place, Result};
use crate::base::limits::Limits;
use crate::model::field::{RadianceField, Shell};
use crate::model::grid::Nodes;
use crate::nested::{self, Middle};
use crate::options::SourceOptions;
use crate::sparse::{CellBox, RowGrid};

/// Boxes may fall short of the last sphere by this share. With the usual 64 layers, this saves a
/// box that would hold 4 of 260 half edges.
const ENDS: f64 = 0.98;
/// Cells along an edge of a model whose first box is larger than its own, at most: a box of 514
/// nodes takes minutes.
const MOST_CELLS: usize = 256;
/// Distance from the middle of substitute camera positions, in half edges.
const ASIDE: f64 = 0.4;

/// Viewpoints for the spheres: camera positions, or substitutes in the unit sphere.
pub(super) fn viewers(space: &SphereSpace, cameras: &[[f64; 3]]) -> Viewers {
    let places: Vec<_> = cameras.iter().map(|at| space.place(*at)).collect();
    match places.is_empty() {
        true => Viewers::of(&[[ASIDE, 0.0, 0.0], [0.0, ASIDE, 0.0], [0.0, 0.0, ASIDE]]),
        false => Viewers::of(&places),
    }
}

/// Nodes of the first box beyond the faces of the cells: enough to double its size, where the
/// spheres have no more detail than the next box, unless that takes too many nodes.
fn border(cells: Nodes) -> usize {
    let largest = cells.0.into_iter().max().unwrap_or(0);
    if largest <= MOST_CELLS { largest / 2 + 1 } else { CellBox::BORDER }
}

/// Adds boxes around a field, and the background to its own box. `rows` gives its density and
/// colours.
pub(super) fn surround(
    field: &mut RadianceField,
    world: Arc<WholeFile>,
    options: &SourceOptions,
    rows: impl Fn(usize) -> [RowGrid; 2],
    limits: &Limits,
) -> Result<()> {
    let end = ENDS * farthest(world.spheres.layers(), world.step_size);
    let extent = options.extent.map_or(end, f64::from);
    let SphereSpace { center, radius } = world.space;
    let border = border(world.arrays.cells.cells);
    let middle = Middle { center, radius };
    let first = match options.resolution {
        Some(nodes) if world.resampled => nested::even(middle, nodes, extent),
        _ => world.arrays.cells.lattice_beyond(border),
    };
    let place = Place::Tensor("background_data".to_owned());
    let lattices = nested::boxes(first, middle, extent, limits, &place)?;
    let scene = &mut field.scene;
    (scene.bounds, scene.nodes) = (first.bounds, first.nodes);
    scene.march.sampled = None;
    scene.march.check(scene.nodes)?;
    let around = |lattice: &_| sampled_box(&world, *lattice, scene);
    let Shell { density, color, .. } = match world.resampled {
        true => around(&first),
        false => own_box(&world, (first, border), || rows(border)),
    };
    let shells = lattices.get(1..).unwrap_or_default().iter().map(around).collect();
    (field.density, field.color, field.shells) = (density, color, shells);
    field.check()
}
