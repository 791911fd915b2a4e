//! Grids whose nodes are rows of arrays, behind an index: Plenoxels' links, blocks of sampled
//! arrays, or the nodes in their own order.
//!
//! [`Index`] maps nodes to rows. [`RowArray`] reads rows from their file. Both serve two readers:
//! [`RowGrid`] feeds a bake slab by slab and caches a few slabs, so that no dense grid is ever
//! made; [`LoadedRows`] holds all rows in memory for a model that is rendered by its own rules.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod array;
mod cells;
mod colored;
mod grid;
mod index;
mod loaded;
mod path;
mod slab;

pub use array::{MakeBytes, RowArray};
pub use cells::CellBox;
pub use colored::ColoredRows;
pub use grid::{Channel, RowGrid};
pub use index::{Index, LoadedIndex, PlaneRows};
pub use loaded::{Cell, LoadedRows, whole};
pub use path::{GridPath, Lattice};
