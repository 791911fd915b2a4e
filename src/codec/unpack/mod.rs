//! A container back to dense arrays: the stored values after dequantization, before any
//! activation. Blocks that are not stored read as their level's empty values.
//!
//! [`tensors`] writes one safetensors file, which bakes again to the same atlases; [`slices`]
//! writes pictures of every x plane. Both go plane by plane: memory is one level's codes.
//!
//! [`Unpacked`] is the way back: [`read`] opens a file of dense arrays, and [`levels`] decodes a
//! container that was never unpacked.

mod levels;
mod npz;
mod planes;
mod read;
mod slices;
mod tensors;

pub use levels::{LevelValues, Unpacked, UnpackedLevel};
use planes::check_levels;
pub(crate) use planes::fill_plane;
pub use slices::{SliceFormat, write_slices};
pub use tensors::{TensorFormat, read_tensors, write_tensors};
