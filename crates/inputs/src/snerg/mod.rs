//! SNeRG's folders of assets, as its exporter and that of Mip-VoG write them.
//!
//! `scene_params.json` states sizes and the network; pictures beside it hold an atlas of blocks:
//! see [`layout`]. Texels are a colour and four features, both multiplied by the opacity of one
//! voxel.
//!
//! **Its own rules** are those of its viewer. A sample a voxel, half a voxel behind each entry;
//! blocks that show nothing are skipped, and samples start half a voxel behind them again. Opacity
//! and the multiplied values are interpolated, the apron's too. The background is added *before*
//! the network runs, once per ray, on all of it.
//!
//! **The field** has a node in the middle of each voxel, and one of nothing beyond each face. Nodes
//! hold the opacity, which a renderer interpolates as the viewer does, and the colours without it.
//! A node of opacity 0 takes the colours of its neighbours, weighted by opacity: these are what the
//! interpolation of multiplied values tends to. A container adds the background after the network
//! ran, so half-transparent pixels differ.
//!
//! The atlas may be gigabytes. It is read picture by picture, and only texels of some opacity are
//! kept, with the texels that are interpolated with them.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod assets;
pub mod layout;
mod model;
mod open;
mod parameters;

pub use open::{knows, open_tensors};
