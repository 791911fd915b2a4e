//! MERF's folders of assets, from its exporter and from its first demonstration.
//!
//! A value is the sum of a sparse grid and three planes, each interpolated separately. The sums are
//! logits of a colour and of four features, and `1 + ln` of a density. They span contracted space,
//! from -2 to 2 along each axis; its core, from -1 to 1, is the world itself.
//!
//! **A whole scene** follows the rules of MERF's baked renderer: steps of a voxel in contracted
//! space from the near plane on, without an end. Its field has nested boxes, up to the start of the
//! last voxel of contracted space. With `--drop-background`, only the core is read, and the
//! following applies to it.
//!
//! **Its own rules** are those of its viewer, within the core: samples one voxel apart from the
//! entry on, five occupancy grids that skip empty cells and half a step, and no samples where the
//! sparse grid has no block. The background is added before the network runs, once per ray.
//!
//! **The field** has a node in the middle of each voxel of the finer of both grids, and the next
//! one beyond each face. Colours and features are sums of logits, as they are. Densities are
//! converted to a softplus, which matches the viewer's exponential while a voxel absorbs little
//! light, and differs from it between nodes of high density. Nodes more than a voxel away from
//! occupied space are empty.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod contraction;
mod model;
mod nodes;
mod occupancy;
mod open;
mod parameters;
mod planes;
mod sums;
mod whole;
mod world;

pub use open::{knows, open_tensors};
