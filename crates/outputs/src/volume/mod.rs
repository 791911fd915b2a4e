//! Volumes of density and colour at lattice points, for effects programs and engines.
//!
//! Formats write a [`SparseVolume`]: activated values of a field in leaves of 8 x 8 x 8 points,
//! colours in linear light. A [`VolumeModel`] is read back, and rendered by the rules of those
//! programs.

mod leaf;
mod mean_colors;
mod model;
mod request;
mod sparse;

pub use leaf::{Leaf, LeafMask, POINTS, SIDE, place_of, points};
pub use model::{Extinction, VolumeModel, VolumePoints};
pub use request::{lattice, lattice_of, lost, volume};
pub use sparse::{SparseVolume, VolumeOptions};
