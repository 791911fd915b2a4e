//! Bakes trained Mip-VoG radiance fields into sparse, quantized, coarse-to-fine assets.

pub mod activate;
pub mod bake;
pub mod baked;
pub mod bytes;
pub mod camera;
pub mod check;
#[cfg(feature = "cli")]
pub mod cli;
pub mod container;
pub mod error;
pub mod field;
pub mod finding;
pub mod grid;
pub mod limits;
pub mod mips;
pub mod parallel;
pub mod picture;
pub mod progress;
pub mod prune;
pub mod quantize;
pub mod render;
pub mod sample;
pub mod source;
pub mod tensor;
pub mod unpack;
pub mod view_mlp;
