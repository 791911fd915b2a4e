//! Values to bytes and back: quantizers, prediction, the container, dense arrays.

pub mod container;
pub mod quantize;
pub mod unpack;
