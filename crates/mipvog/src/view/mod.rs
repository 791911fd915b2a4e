//! Rays and pictures: values between nodes, the reference renderer, errors of pictures, views of
//! the whole scene, regular lattices of points.

pub mod compare;
mod lattice;
mod overview;
pub mod render;
pub mod sample;

pub use lattice::Lattice;
#[cfg(feature = "pictures")]
pub use overview::overview_png;
pub use overview::{INSIDE_ANGLE, overview, panorama, standpoints};
