//! glTF assets: fields attached to them, and meshes that viewers without the extension show.

pub mod asset;
pub mod attach;
pub mod mesh;
pub mod mesh_file;
