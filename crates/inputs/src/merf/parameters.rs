//! The numbers of `scene_params.json`, by either set of names.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{AtlasFiles, AtlasLayout, Axes, Numbers, Texel};
use crate::model::grid::Nodes;
use crate::snerg::layout::{INDICES, feature_name, rgba_name};
use crate::sparse::CellBox;
use crate::tensor::{TensorFile, Value};

/// Edge of contracted space.
pub(super) const SPAN: f64 = 4.0;
/// Its lowest corner along each axis.
pub(super) const LOW: f64 = -2.0;
/// Voxels along an edge of a block, at most.
const LARGEST_BLOCK: u64 = 256;
/// Edges of voxels may be rounded by this share.
const ROUNDED: f64 = 1e-4;
/// The ranges of codes that are built into the first viewer.
const FEATURES: [f64; 2] = [-7.0, 7.0];
const DENSITIES: [f64; 2] = [-14.0, 14.0];

/// Keys that only MERF's folders have, of the release and of the demonstration.
pub(super) const KEYS: [&str; 4] =
    ["triplane_resolution", "sparse_grid_resolution", "voxel_size_triplane", "plane_width_0"];
/// Keys of SMERF, whose network differs from place to place.
const KEYS_OF_SMERF: [&str; 3] = ["num_submodels", "submodel_scale", "deferred_mlp"];

/// The names of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Names {
    Release,
    Demonstration,
}

impl Names {
    /// The pictures of an atlas. Codes of 0 are values too.
    fn atlas(self) -> AtlasFiles {
        let is_nothing = |texel: &Texel| *texel == [0; 8];
        match self {
            Self::Release => AtlasFiles {
                indices: "sparse_grid_block_indices.png",
                names: |z| {
                    let colors = format!("sparse_grid_rgb_and_density_{z:03}.png");
                    [colors, format!("sparse_grid_features_{z:03}.png")]
                },
                planes: 1,
                is_nothing,
            },
            Self::Demonstration => AtlasFiles {
                indices: INDICES,
                names: |z| [rgba_name(z), feature_name(z)],
                planes: 1,
                is_nothing,
            },
        }
    }
}

/// A sparse grid and its atlas.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sparse {
    /// Voxels along each axis.
    pub(super) resolution: usize,
    /// Voxels along an edge of a block; its texels are one more.
    pub(super) block: usize,
    /// Texels of the atlas.
    pub(super) atlas: [usize; 3],
}

impl Sparse {
    /// Its blocks and their atlas.
    pub(super) fn layout(&self, names: Names) -> AtlasLayout {
        AtlasLayout {
            files: names.atlas(),
            counts: [self.resolution.div_ceil(self.block); 3],
            edge: self.block + 1,
            size: self.atlas,
            has_features: true,
        }
    }
}

/// Sizes of a folder.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    pub(super) names: Names,
    pub(super) sparse: Option<Sparse>,
    /// Texels along an edge of the planes.
    pub(super) planes: Option<usize>,
    /// Densities of the first and the last code.
    pub(super) densities: [f64; 2],
    /// The same of colours and features.
    pub(super) features: [f64; 2],
    pub(super) axes: Axes,
}

impl Parameters {
    /// Reads them, and checks their consistency.
    pub(super) fn read(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let place = |key: &str| Place::Key(key.to_owned());
        let numbers = Numbers::of(file, limits);
        numbers.refuse_other_kinds()?;
        let has = |key: &str| file.root.get(key).is_some_and(|value| !value.is_none());
        if let Some(key) = KEYS_OF_SMERF.into_iter().find(|key| has(key)) {
            let found = "a SMERF scene, whose network differs from place to place";
            return Err(Error::unsupported(place(key), found, "a MERF scene, with one network"));
        }
        let release = has("triplane_resolution") || has("sparse_grid_resolution");
        let (names, keys) = match release {
            true => (Names::Release, ["triplane_resolution", "sparse_grid_resolution"]),
            false => (Names::Demonstration, ["plane_width_0", "grid_width"]),
        };
        let resolution = |key: &str| -> Result<Option<usize>> {
            let zero = matches!(file.root.get(key), None | Some(Value::None | Value::Int(0)));
            Some(key).filter(|_| !zero).map(|key| numbers.count(key, limits.axis_nodes)).transpose()
        };
        let [of_planes, of_grid] = keys;
        let (planes, grid) = (resolution(of_planes)?, resolution(of_grid)?);
        let block_key = if release { "data_block_size" } else { "block_size" };
        let sparse = match grid {
            None => None,
            Some(resolution) => Some(Sparse {
                resolution,
                block: numbers.count(block_key, LARGEST_BLOCK)?,
                atlas: numbers.sizes("atlas")?,
            }),
        };
        let edges = match release {
            true => [("triplane_voxel_size", planes), ("sparse_grid_voxel_size", grid)],
            false => [("voxel_size_triplane", planes), ("voxel_size", grid)],
        };
        for (key, resolution) in edges {
            let Some(resolution) = resolution else { continue };
            let (found, expected) = (numbers.length(key)?, SPAN / resolution as f64);
            if (found / expected - 1.0).abs() > ROUNDED {
                let expected = format!("{expected}, contracted space in {resolution} voxels");
                return Err(Error::unsupported(place(key), found.to_string(), expected));
            }
        }
        let Some(finest) = planes.or(grid) else {
            let found = "neither a sparse grid nor planes";
            return Err(Error::malformed(place(of_grid), found, "one of both"));
        };
        if !finest.is_multiple_of(4) {
            let expected = "a multiple of 4, so that voxels end where the core does";
            return Err(Error::unsupported(place(of_planes), finest.to_string(), expected));
        }
        let nodes = finest as u64 / 2 + 1;
        Nodes::checked([nodes; 3], limits, &place(of_planes))?;
        let range = |key: &str, usual: [f64; 2]| -> Result<[f64; 2]> {
            let Some(value) = file.root.get(key).filter(|value| !value.is_none()) else {
                return Ok(usual);
            };
            match value.numbers(key)?.as_slice() {
                &[low, high] if low.is_finite() && high.is_finite() && low < high => {
                    Ok([low, high])
                }
                other => {
                    let expected = "a lower, then a higher number";
                    Err(Error::malformed(place(key), format!("{other:?}"), expected))
                }
            }
        };
        Ok(Self {
            names,
            sparse,
            planes,
            densities: range("range_density", DENSITIES)?,
            features: range("range_features", FEATURES)?,
            axes: Axes::stated(file, &mut Budget::new(limits))?,
        })
    }

    /// Voxels of the finer grid along an edge of contracted space; the viewer steps by one.
    pub(super) fn resolution(&self) -> usize {
        // The viewer steps by the planes' voxels where there are planes.
        self.planes.or(self.sparse.map(|sparse| sparse.resolution)).unwrap_or(0)
    }

    /// Edge of a voxel, in world units.
    pub(super) fn voxel_size(&self) -> f64 {
        SPAN / self.resolution() as f64
    }

    /// The core's voxels as a box of the world.
    pub(super) fn cells(&self) -> CellBox {
        let cells = Nodes([self.resolution() / 2; 3]);
        CellBox { radius: [1.0; 3], center: [0.0; 3], cells }
    }
}
