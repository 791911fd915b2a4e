//! The numbers of `scene_params.json`.

use super::axes::Axes;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::sparse::CellBox;
use crate::input::tensor::{TensorFile, Value};
use crate::model::grid::Nodes;
use crate::model::snerg::{APRON, PLANES, SKIPPED_CUBE};

/// Texels along an edge of a block, at most.
const LARGEST_BLOCK: usize = 256;

/// Keys of MERF and SMERF, of the release and of the first demonstration.
const PLANES_OF_MERF: [&str; 4] =
    ["triplane_resolution", "sparse_grid_resolution", "voxel_size_triplane", "plane_width_0"];

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
    /// Pictures of either kind.
    pub(super) slices: usize,
    pub(super) axes: Axes,
}

impl Parameters {
    /// Reads them, and holds them against each other.
    pub(super) fn read(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let root = &file.root;
        let flag =
            |key: &str| root.get(key).is_some_and(|value| value.boolean(key).is_ok_and(|b| b));
        let place = |key: &str| Place::Key(key.to_owned());
        if let Some(key) = PLANES_OF_MERF.into_iter().find(|key| root.get(key).is_some()) {
            let found = "a MERF scene: a grid and three planes in contracted space";
            return Err(Error::unsupported(place(key), found, "a SNeRG folder, a grid in a box"));
        }
        if flag("ndc") {
            let found = "a scene in normalised device coordinates";
            return Err(Error::unsupported(place("ndc"), found, "a scene in a box"));
        }
        if let Some(Value::Text(format)) = root.get("format")
            && format != "png"
        {
            return Err(Error::unsupported(place("format"), format, "png"));
        }
        let number = |key: &str| -> Result<f64> {
            let value = root.get(key).unwrap_or(&Value::None).number(key)?;
            let checked = value.is_finite().then_some(value);
            let refuse = || Error::malformed(place(key), value.to_string(), "a finite number");
            checked.ok_or_else(refuse)
        };
        let count = |key: &str, most: u64| -> Result<usize> {
            let value = root.get(key).unwrap_or(&Value::None).integer(key)?;
            let fits =
                usize::try_from(value).ok().filter(|_| (1..=most.cast_signed()).contains(&value));
            fits.ok_or_else(|| {
                Error::malformed(place(key), value.to_string(), format!("1 to {most}"))
            })
        };
        let sizes = |prefix: &str, most: u64| -> Result<[usize; 3]> {
            let [x, y, z] = ["width", "height", "depth"].map(|name| format!("{prefix}_{name}"));
            Ok([count(&x, most)?, count(&y, most)?, count(&z, most)?])
        };
        let voxel_size = number("voxel_size")?;
        if voxel_size <= 0.0 {
            return Err(Error::malformed(place("voxel_size"), voxel_size.to_string(), "above 0"));
        }
        let block = count("block_size", LARGEST_BLOCK as u64)?;
        if !(block + 2 * APRON).is_multiple_of(SKIPPED_CUBE) {
            let expected = format!("{} less than a multiple of {SKIPPED_CUBE}", 2 * APRON);
            return Err(Error::unsupported(place("block_size"), block.to_string(), expected));
        }
        let grid = sizes("grid", limits.axis_nodes)?.map(|size| size as u64);
        let grid = Nodes::checked(grid, limits, &place("grid_width"))?;
        let atlas = sizes("atlas", limits.axis_nodes)?;
        let slices = count("num_slices", limits.axis_nodes)?;
        let [_, _, depth] = atlas;
        if slices.checked_mul(PLANES) != Some(depth) {
            let found = format!("{slices} slices for an atlas {depth} deep");
            let expected = format!("{PLANES} planes a slice");
            return Err(Error::malformed(place("num_slices"), found, expected));
        }
        let axes = match root.get("worldspace_T_opengl") {
            None | Some(Value::None) => Axes::default(),
            Some(Value::Tensor(matrix)) => Axes::of(matrix, &mut Budget::new(limits))?,
            Some(other) => {
                let place = place("worldspace_T_opengl");
                return Err(Error::malformed(place, other.describe(), "a matrix [4, 4]"));
            }
        };
        let min = [number("min_x")?, number("min_y")?, number("min_z")?];
        Ok(Self { voxel_size, block, grid, min, atlas, slices, axes })
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
