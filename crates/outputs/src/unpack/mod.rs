//! Unpacks a container to dense arrays: the stored values after dequantization, before any
//! activation. Blocks that are not stored read as their level's empty values.
//!
//! [`write_tensors`] writes one safetensors file or NumPy archive, which bakes again to the same
//! atlases; [`write_slices`] writes pictures of every x plane. Both work plane by plane, so memory
//! holds one level's codes.

mod npz;
mod slices;
mod tensors;

pub use slices::{SliceFormat, write_slices};
pub use tensors::{TensorFormat, write_tensors};
