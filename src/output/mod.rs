//! Formats that other programs read, a file or a folder each.

pub mod gltf;
