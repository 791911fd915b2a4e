//! Grids that are stored as sums of products of planes and lines: TensoRF, and DirectVoxGO's
//! `TensoRFGrid`.
//!
//! Each axis occurs once in a product. So the product of interpolated factors equals the trilinear
//! interpolation of products at nodes, and a grid of nodes represents such a model exactly.
//! Products are computed plane by plane, at the nodes that a bake requests.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod grid;
mod mix;
mod parts;
mod product;

pub use grid::FactorGrid;
pub use mix::{FactorArrays, Mix, Mixed, Scratch};
pub use parts::{Part, Terms, components};
pub use product::Tap;
