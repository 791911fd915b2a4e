//! Whole scenes as nested boxes.
//!
//! Models of unbounded scenes have no box: their space is contracted beyond an inner one, or their
//! cells grow with the distance. A field has boxes with growing node distances
//! ([`Shell`](crate::model::field::Shell)), so such a model is sampled at the nodes of each.
//!
//! **Boxes.** The first box reaches twice as far as the model's inner one, and its nodes are as far
//! apart as the model's own, with which they coincide where space is not contracted. Each next box
//! reaches twice as far, with about as many nodes ([`boxes`]). Measured on contracted grids of 64
//! and 128 nodes, this rule loses the least for the fewest nodes (39 and 45 dB).
//!
//! **Values.** Where a box is at least as fine as the model, a node has the model's value at its
//! point. Where it is coarser, a node has the mean over points of its cell: of optical depth per
//! world unit, and of colours weighted by the light that the points absorb. The width of the mean
//! accounts for the model's own resolution:
//!
//! ```text
//! width^2 = spacing of nodes^2 - spacing of the model's values^2
//! ```
//!
//! **Colours** of a network that runs per sample are fitted as in a single box, but shells are seen
//! from within: from cameras, or from places around the middle of the inner box.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod assemble;
mod cell;
mod colors;
mod density;
mod matter;
mod plan;
mod world;

pub use assemble::{Colors, fitted_colors, shells};
pub use cell::points;
pub use density::SampledDensity;
pub use plan::{Middle, aligned, boxes, even};
pub use world::{ColoredWorld, World};
