//! glTF assets: fields attached to them, and meshes for viewers without the extension.

pub mod asset;
pub mod attach;
pub mod mesh;
pub mod mesh_file;
