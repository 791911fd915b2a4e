//! The numbers of `scene_params.json`.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{Axes, Numbers};
use crate::model::grid::Nodes;
use crate::snerg::layout::{APRON, PLANES, SKIPPED_CUBE};
use crate::sparse::CellBox;
use crate::tensor::TensorFile;

/// Texels along an edge of a block, at most.
const LARGEST_BLOCK: usize = 256;

/// Sizes of a folder, in its own axes.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    /// Edge of a voxel, in world units.
    pub(super) voxel_size: f64,
    /// Voxels along an edge of a block.
    pub(super) block: usize,
    /// Voxels.
    pub(super) grid: Nodes,
    /// The lowest corner.
    pub(super) min: [f64; 3],
    /// Texels of the atlas.
    pub(super) atlas: [usize; 3],
    pub(super) axes: Axes,
}

impl Parameters {
    /// Reads them, and checks their consistency.
    pub(super) fn read(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let place = |key: &str| Place::Key(key.to_owned());
        let numbers = Numbers::of(file, limits);
        numbers.refuse_other_kinds()?;
        let voxel_size = numbers.length("voxel_size")?;
        let block = numbers.count("block_size", LARGEST_BLOCK as u64)?;
        if !(block + 2 * APRON).is_multiple_of(SKIPPED_CUBE) {
            let expected = format!("{} less than a multiple of {SKIPPED_CUBE}", 2 * APRON);
            return Err(Error::unsupported(place("block_size"), block.to_string(), expected));
        }
        let grid = numbers.sizes("grid")?.map(|size| size as u64);
        let grid = Nodes::checked(grid, limits, &place("grid_width"))?;
        let atlas = numbers.sizes("atlas")?;
        let slices = numbers.count("num_slices", limits.axis_nodes)?;
        let [_, _, depth] = atlas;
        if slices.checked_mul(PLANES) != Some(depth) {
            let found = format!("{slices} slices for an atlas {depth} deep");
            let expected = format!("{PLANES} planes per slice");
            return Err(Error::malformed(place("num_slices"), found, expected));
        }
        let axes = Axes::stated(file, &mut Budget::new(limits))?;
        let [x, y, z] = ["min_x", "min_y", "min_z"];
        let min = [numbers.number(x)?, numbers.number(y)?, numbers.number(z)?];
        Ok(Self { voxel_size, block, grid, min, atlas, axes })
    }

    /// Texels along an edge of a block with its apron.
    pub(super) fn edge(&self) -> usize {
        self.block + 2 * APRON
    }

    /// Blocks along each axis of the grid.
    pub(super) fn blocks(&self) -> [usize; 3] {
        self.grid.0.map(|size| size.div_ceil(self.block))
    }

    /// The voxels as a box of the world.
    pub(super) fn cells(&self) -> CellBox {
        let (mut radius, mut center) = ([0.0; 3], [0.0; 3]);
        let axes = radius.iter_mut().zip(&mut center).zip(self.grid.0).zip(self.min);
        for (((radius, center), count), min) in axes {
            *radius = 0.5 * count as f64 * self.voxel_size;
            *center = min + *radius;
        }
        let radius = self.axes.to_world(radius).map(f64::abs);
        let center = self.axes.to_world(center);
        CellBox { radius, center, cells: Nodes(self.axes.sizes(self.grid.0)) }
    }

    /// A position of the world in voxels, 0 being the lowest corner.
    pub(super) fn to_voxels(&self, world: [f64; 3]) -> [f64; 3] {
        let mut own = self.axes.within(world);
        let axes = own.iter_mut().zip(self.min);
        axes.for_each(|(at, min)| *at = (*at - min) / self.voxel_size);
        own
    }
}
