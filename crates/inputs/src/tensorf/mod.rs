//! TensoRF, as its own code writes it: a PyTorch file `NAME.th`.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | `kwargs` | | box, nodes, activation, step, shading |
//! | `state_dict.density_plane.I`, `app_plane.I` | `[1, C, second axis, first axis]` | factors of xy, xz and yz; a CP model has none |
//! | `state_dict.density_line.I`, `app_line.I` | `[1, C, N, 1]` | factors of z, y and x |
//! | `state_dict.basis_mat.weight` | `[features, components]` | products of factors to features |
//! | `state_dict.renderModule.mlp.{0,2,4}` | | the network of the shadings `MLP_Fea`, `MLP_PE`, `MLP` |
//! | `state_dict.plane_coef`, `line_coef` | `[3, C, N, N]`, `[3, C, N, 1]` | the first layout: all factors of colours, then those of density |
//! | `alphaMask.shape`, `.mask`, `.aabb` | | one bit for a node, first bit highest, in a box of its own |
//!
//! nerfstudio's method `tensorf` trains the same model and writes it under its own names.
//!
//! **The field** is a grid of [`factors`](crate::factors), which holds density and features
//! exactly.
//!
//! **Colours.** The shading `SH` is harmonics, `RGB` plain colours. A network is fitted at each
//! node with harmonics, over directions all around.
//!
//! **Its own rules** ([`TrainedModel`](crate::model::trained_model::TrainedModel)) are those of
//! TensoRF's renderer: samples from the face of the box on, the last one without a length, colours
//! where a weight is over a threshold, a picture clamped to 0 to 1. nerfstudio samples in two
//! passes: evenly, then where the first pass found density.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod keys;
mod mask;
mod model;
mod nerfstudio;
mod open;
mod read;
mod shading;
mod two_passes;
mod values;

pub use open::{knows, open_tensors};
