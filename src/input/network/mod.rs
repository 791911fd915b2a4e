//! Colours that a network makes for each sample, which no container holds: the network, and a fit
//! of harmonics to it at nodes.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod fit;
mod planes;
mod run;

pub use fit::Fit;
pub use planes::{PlaneCache, lock, visit};
pub use run::{Inputs, Network, NetworkFile};
