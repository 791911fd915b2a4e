//! Instant-NGP's snapshots (`.msgpack`, `.ingp`) and torch-ngp's checkpoints (`.pth`): tables of
//! features on cubic grids of many sizes, a network for density and a network for colour.
//!
//! ```text
//! features = of each level the eight table entries around the position, interpolated
//! h        = density network(features);  density = exp(h[0])
//! colour   = sigmoid(colour network(h, harmonics of degree 3 of the direction))
//! ```
//!
//! Small levels have an entry for each node; the others share entries by a hash of the node. The
//! snapshot does not state the sizes of levels: they are computed, and checked by the number of
//! parameters.
//!
//! **Its own rules.** Steps have one length, the unit cube's diagonal in 1024; in scenes of several
//! unit cubes they grow with the distance from the camera, as do the cells. Samples outside
//! occupied cells are skipped. Instant-NGP ends a ray at a transmittance below 0.01 and divides its
//! colour by the rest, torch-ngp ends it below 1e-4.
//!
//! **The field.** The model has no nodes: the networks are evaluated at nodes of a grid, in and
//! next to occupied cells, and harmonics are fitted to the colours. The occupied cells are the
//! field's mask of free space. More boxes surround the unit cube; their nodes are empty outside
//! occupied cells.
//!
//! No snapshot of the real Instant-NGP has been tried yet, so its [`Source`](super::Source) carries
//! a warning.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod evaluate;
mod file;
mod frame;
mod keys;
mod model;
mod occupancy;
mod open;
mod ratio;
mod snapshot;
mod torch;
mod values;
mod world;

pub use open::{knows_checkpoint, knows_snapshot, open_checkpoint, open_snapshot};
