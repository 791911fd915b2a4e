//! OpenVDB files: `density`, and colours as `Cd`.
//!
//! A point of the volume is a voxel, and a leaf of 8 x 8 x 8 points is a leaf of the tree 5-4-3.
//! A file is its metadata, then each grid with its topology and its values. Values are half
//! floats in zlib streams, which every program reads.

mod file;
mod format;
mod metadata;
mod read_back;
mod tree;

pub use format::{Vdb, check_volume, write_volume};
pub use read_back::{points_of, read_points};
