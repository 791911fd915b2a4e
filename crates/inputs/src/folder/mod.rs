//! Common parts of SNeRG's and MERF's folders of assets: the numbers of their parameters, axes, the
//! network, the atlas of blocks in the pictures beside them, and how their viewers march along
//! rays.
//!
//! A system states its pictures ([`AtlasFiles`]), its values at nodes ([`FieldNodes`]) and the
//! rules of its viewer ([`ViewerRules`]); [`source()`] makes an input of them.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod atlas;
mod axes;
mod block;
mod deferred;
mod network;
mod nodes;
mod numbers;
mod pictures;
mod scene;
mod source;
mod texels;
mod viewer;

pub use atlas::{Atlas, AtlasFiles, AtlasLayout, Places};
pub use axes::Axes;
pub use block::Block;
pub use deferred::{added_light, drops_network, refuse_other_views};
pub use network::{InputOrder, read_network};
pub use nodes::{BORDER, FieldNodes, Logits};
pub use numbers::Numbers;
pub use pictures::{Folder, RGB, RGBA};
pub use scene::scene;
pub use source::{Found, source};
pub use texels::{OPACITY, Texel, Texels};
pub use viewer::{Corners, Light, Samples, Viewed, ViewerRules};
