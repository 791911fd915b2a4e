//! Hash grids and small networks, evaluated at many positions at once.
//!
//! Each feature and neuron has [`LANES`] adjacent values, one per position, so that plain loops are
//! vectorized. Sums have a fixed order, and products are not fused with sums, so results are the
//! same on every machine. Bakes take float32; pictures of an unbaked model, and its values at
//! points, take float64.

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
