//! The meaning of the names in a checkpoint: Mip-VoG and DirectVoxGO to
//! [`crate::model::field::RadianceField`].
//!
//! Both families store grids of raw density and colour in a box, as arrays of nodes or as factors,
//! a small network, a mask of free space, and settings. A missing setting has a default here, an
//! option in [`SourceOptions`](crate::SourceOptions), and an [`Assumption`](crate::Assumption) in
//! the result, to be shown to the user. Background, near and far plane and the colour threshold
//! belong to the scene and are never stored: their usual values (white, 0, none, 1e-4) are defaults
//! like those of any option.
//!
//! Opening reads settings, the network and the mask; the grids stay in the file.

mod coarse;
mod contracted;
mod grids;
mod march;
mod mask;
mod mlp;
mod names;
mod open;
mod stored;
mod wrappers;

pub use contracted::Inner;
pub use mlp::layer_tensors;
pub use names::{NamedValues, STATE};
pub use open::{Whole, describe, open_tensors, open_whole};
pub use stored::StoredGrid;
pub use wrappers::unwrapped;
