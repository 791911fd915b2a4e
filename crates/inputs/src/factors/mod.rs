//! Grids that are stored as sums of products of planes and lines: TensoRF, and DirectVoxGO's
//! `TensoRFGrid`.
//!
//! Each axis occurs once in a product. So the product of interpolated factors is the trilinear
//! interpolation of the products at nodes, and a grid of nodes holds such a model exactly.
//! Products are made plane by plane, at nodes that a bake asks for.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod grid;
mod mix;
mod parts;
mod product;

pub use grid::FactorGrid;
pub use mix::{FactorArrays, Mix, Mixed, Scratch};
pub use parts::{Part, Terms, components};
pub use product::Tap;
