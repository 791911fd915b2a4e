//! Colours from a network per sample, which containers do not support: the network, and a fit of
//! harmonics to it at nodes.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod assumption;
mod batch;
mod cell_views;
mod cell_visibility;
mod fit;
mod fitted;
mod node_set;
mod planes;
mod projected;
mod projection;
mod run;
mod stored;
mod views;
mod visible_nodes;

pub use assumption::fit_assumption;
pub use batch::{Batch, BatchNetwork, Scratch};
pub use cell_views::CellViews;
pub use fit::Fit;
pub use fitted::{Colors, FindColors, FittedColors, NodeColors, OnNode};
pub use planes::{PlaneCache, visit};
pub use projected::{OnPoint, PointColors, ProjectedColors};
pub use run::{Inputs, Network, NetworkFile};
pub use stored::StoredFeatures;
pub use views::{all_around, held_out_eyes};
