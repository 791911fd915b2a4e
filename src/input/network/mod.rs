//! Colours that a network makes for each sample, which no container holds: the network, and a fit
//! of harmonics to it at nodes.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod batch;
mod fit;
mod fitted;
mod planes;
mod run;
mod seen;
mod views;

pub use fitted::FittedColors;
pub use planes::{PlaneCache, visit};
pub use run::{Inputs, Network, NetworkFile};
pub use views::judging_eyes;
