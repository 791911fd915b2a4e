//! nerfstudio's nerfacto: a table of features on cubic grids of many sizes in contracted space, a
//! network for density and one for colour.
//!
//! ```text
//! features    = of each level the eight table entries around the position, interpolated
//! h           = density network(features);  density = mean density * exp(h[0])
//! colour      = sigmoid(colour network(harmonics of the direction, h[1..], appearance))
//! ```
//!
//! Checkpoints are those of nerfstudio 1.1.5, by its own layers or by tiny-cuda-nn
//! (`keys`). Settings that a checkpoint lacks are read from the run's `config.yml`, as text
//! (`yaml`).
//!
//! **Its own rules.** Two density networks propose sample positions; the last round takes few
//! samples, with long steps (`model`). So pictures depend on the sampler, and a field of nodes that
//! is rendered with small steps differs from them.
//!
//! **The field.** The networks are evaluated at nodes of nested boxes, and harmonics are fitted to
//! the colours. The world is the training's, after `dataparser_transforms.json`.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod file;
mod keys;
mod model;
mod open;
mod settings;
mod space;
mod table_sizes;
mod world;

pub use open::{knows, open_tensors};
