//! A container as dense arrays: the stored values after dequantization, before any activation.
//! Blocks that are not stored read as their level's empty values.
//!
//! [`Unpacked`] is a container's levels, with values in its codes or in a file that it was unpacked
//! to. [`read_tensors`] gives them as tensors in memory.

mod levels;
mod planes;
mod rotated;
mod rotation;
mod row;
mod tensors;

pub use levels::{LevelValues, Unpacked, UnpackedLevel};
pub use planes::{check_levels, fill_plane};
pub use rotation::Rotation;
pub use row::{Row, safetensors_digest, safetensors_header};
pub use tensors::{CONTENT, append_all, header, read_tensors, rows, tensor_name, texts};
