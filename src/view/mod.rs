//! Rays and pictures: values between nodes, the reference renderer, distances of pictures.

pub mod compare;
pub mod render;
pub mod sample;
