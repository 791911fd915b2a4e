//! Fog volumes in OpenVDB and NanoVDB files: the grids `density`, and `Cd` or `color`.
//!
//! [`read_grid`] reads the tree of a grid and its raw values; [`Placed`] places its voxels in the
//! world. [`open_tensors`] makes a field with nodes at the voxels' middles: density is optical
//! depth per world unit, colours are converted from linear light to sRGB and do not depend on the
//! view.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod blosc;
mod codec;
mod grid;
mod nano;
mod nodes;
mod open;
mod placed;
mod tree;

pub use grid::{VdbGrid, grid_names, read_grid};
pub use open::{knows, open_tensors};
pub use placed::Placed;
pub use tree::{LEAF_VOXELS, Tile, Tree, VdbLeaf};
