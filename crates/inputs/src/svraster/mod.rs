//! SVRaster and programs that share its files, such as GeoSVR: sparse voxels of an octree.
//!
//! Sources: the code of SVRaster (2025) and of GeoSVR (2026), and svraster-webgl's PLY files.
//!
//! **File.** Voxels have a path, three bits for each of up to 16 levels with x highest, and a
//! level. Raw densities belong to the distinct corners of all voxels, sorted by x, y and z. Each
//! voxel has harmonics of up to degree 3; training uses those up to `active_sh_degree`. A quantized
//! file has codebook indices instead.
//!
//! ```text
//! edge of a voxel = scene_extent / 2^level
//! inner box       = inside_extent a side, around scene_center
//! optical depth per world unit = 100 e(raw, interpolated between the voxel's corners)
//! e(d)            = d above 1.1, else exp(0.909090909091 d - 0.904689820196)
//! colour          = max(0, 0.5 + harmonics(from the camera to the voxel's middle))
//! ```
//!
//! **Rays** by its own rules ([`model`]) meet voxels in order. A voxel has one sample or a few, in
//! the middle of equal parts of its chord.
//!
//! **Field.** Nodes of a box are corners of the octree's cells of one level ([`plan`]), so a voxel
//! of that size or larger keeps its densities at all of its nodes. Smaller voxels are averaged:
//! optical depths by volume, colours by absorbed light. Colours are constant within a voxel; those
//! of nodes are means of the voxels around them, with the same weights ([`plane`]). A free-space
//! mask of the leaves keeps the density of shared corners from empty cells. Nested boxes hold the
//! surroundings of the inner box ([`crate::nested`]).

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod colors;
mod config;
mod corners;
mod density;
mod even;
mod grids;
mod keys;
mod loaded;
mod model;
mod octree;
mod open;
mod plan;
mod plane;
mod ply_rows;
mod settings;

pub use keys::knows;
pub use open::open_tensors;
