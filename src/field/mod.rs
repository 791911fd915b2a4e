//! A radiance field as trained: dense node-centred grids, a view-dependent network, and how a ray
//! is marched through them. Grids stay in their file and are read by position.

mod free_space;
mod planes;
mod scene;
mod volume;

pub use free_space::{FreeSpace, Lookup};
pub use planes::{EMPTY_DENSITY, Found, Nonfinite, PlaneRead, Planes};
pub use scene::{Activation, ActivationOrder, March, Scene};
pub use volume::Volume;

use crate::view_mlp::ViewMlp;

/// A trained scene, grids not yet read.
#[derive(Debug, Clone)]
pub struct RadianceField {
    /// What a renderer needs beside the grids.
    pub scene: Scene,
    /// Raw logits, one channel.
    pub density: Volume,
    /// Raw logits: 3 diffuse colour channels, then the specular features.
    pub color: Volume,
    /// View-dependent colour, added once a ray; without it the scene is diffuse.
    pub view_mlp: Option<ViewMlp>,
    /// Where training kept samples; without it everywhere.
    pub free_space: Option<FreeSpace>,
}
