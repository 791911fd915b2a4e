//! The content of a container and its geometry: metadata and codes, activations, grids,
//! view-dependent colour.

pub mod activate;
pub mod anisotropy;
pub mod baked;
pub mod directional;
mod free_space;
pub mod generated;
pub mod grid;
pub mod harmonics;
pub mod scene;
pub mod view_dependence;
pub mod view_mlp;
