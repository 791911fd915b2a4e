//! SNeRG's folders of assets, as its exporter and that of Mip-VoG write them.
//!
//! `scene_params.json` states sizes and the network; pictures beside it hold an atlas of blocks:
//! see [`layout`]. Texels are a colour and four features, both premultiplied by the opacity of one
//! voxel.
//!
//! **Its own rules** are those of its viewer. There is one sample per voxel, starting half a voxel
//! behind each entry. Empty blocks are skipped, and samples start again half a voxel behind them.
//! Opacity and the premultiplied values are interpolated, including the apron. The background is
//! added *before* the network runs, once per ray, on the sum.
//!
//! **The field** has a node in the middle of each voxel, and an empty node beyond each face. Nodes
//! hold the opacity, which a renderer interpolates like the viewer, and the colours, not
//! premultiplied. A node of opacity 0 takes the colours of its neighbours, weighted by opacity:
//! these are the limit of interpolating premultiplied values. A container adds the background after
//! the network, so half-transparent pixels differ.
//!
//! The atlas may be gigabytes. It is read picture by picture, and only texels above opacity 0 and
//! their neighbours for interpolation are kept.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod assets;
pub mod layout;
mod model;
mod open;
mod parameters;

pub use open::{knows, open_tensors};
