//! DirectVoxGO with its default network, which runs for every sample.
//!
//! Density, settings and the mask are those of [`checkpoint`](crate::checkpoint). All
//! channels of `k0` are inputs of the network, with the direction and its embedding; without
//! `rgbnet_direct` the first three are logits of colours, to which the network adds.
//!
//! Density and features are arrays of nodes or [`factors`](crate::factors). An unbounded scene is
//! sampled in nested boxes ([`nested`](crate::nested)), or cropped to its inner box, where its grid
//! is a plain one.
//!
//! **The field** has harmonics that are fitted to the network at each node.
//!
//! **Its own rules** ([`TrainedModel`](crate::model::trained_model::TrainedModel)) are those of
//! DirectVoxGO's renderer: samples of low opacity are skipped, the network colours samples with a
//! weight over a threshold, and a ray ends at a transmittance of 1e-3. In unbounded scenes, samples
//! are counted from the camera, with growing distances.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod contraction;
mod fitted;
mod model;
mod open;
mod open_unbounded;
mod unbounded_model;
mod values;
mod world;

pub use open::{knows, open_tensors};
