//! Rays and pictures: values between nodes, the reference renderer, distances of pictures, a view
//! of the whole scene.

pub mod compare;
mod overview;
pub mod render;
pub mod sample;

pub use overview::overview;
