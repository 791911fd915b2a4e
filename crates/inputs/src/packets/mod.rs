//! Hash grids and small networks, evaluated at many positions at once.
//!
//! Values lie position by position within each feature and each neuron, [`LANES`] of them, so that
//! plain loops over them become vector instructions. Sums have one order, and no product is fused
//! with a sum, so results are the same on every machine. Bakes take float32; pictures of an unbaked
//! model, and its values at points, take float64.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod encode;
mod field;
mod grid;
mod kernels;
mod levels;
mod multiply;
mod network;
mod perceptron;
mod real;
mod stored;

pub use encode::Coordinates;
pub use field::{FieldScratch, Found, HashField};
pub use grid::{HashGrid, gathered};
pub use levels::{Levels, Sizes};
pub use network::{Directions, HashNetwork, Places, Scratch, ViewNetwork};
pub use perceptron::{Layer, Number};
pub use real::{LANES, Lanes, Real};
pub use stored::{Matrix, Values};
