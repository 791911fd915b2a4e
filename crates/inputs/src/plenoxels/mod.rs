//! Plenoxels, as svox2 writes them: `ckpt.npz`, and `args.json` beside it.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | `radius`, `center` | `[3]` | half the box's edges, and its middle, in world units |
//! | `links` | i32 `[X, Y, Z]` | the row of each cell; any negative number is an empty one |
//! | `density_data` | `[n, 1]` | density per world unit before it is cut at 0; may be negative |
//! | `sh_data` | `[n, 3 B]` | harmonics: `B` of red, then of green, then of blue |
//! | `data` | `[n, 1 + 3 B]` | in place of both, in older files |
//! | `basis_type` | | 1, harmonics; all other bases are refused |
//! | `background_links`, `background_data` | | spheres behind the box: see `spheres` |
//!
//! PeRFception's checkpoints hold the same in other keys: see `lightning`.
//!
//! **The field.** Cell `i` of `N` has its value at its middle, `center + radius ((2 i + 1) / N -
//! 1)`. A field's nodes span its box, so one node is added beyond each face, a copy of the face's
//! own, and rays are sampled from face to face of the cells, as svox2 does. An empty cell has
//! density 0 and coefficients 0, which is grey: that is part of the model, and surfaces fade to it.
//! Density is cut at 0 after interpolation, colours at 0 where a ray ends.
//!
//! **Voxels that are no cubes.** svox2 steps by half a cell counted along the ray, so the length of
//! a step depends on the ray's direction. The field states the voxel's three edges
//! ([`March::voxel`](crate::model::field::March::voxel)), and a container has them too.
//!
//! **Spheres behind the box** make a whole scene: [nested boxes](crate::nested), of which the first
//! one is the box of the model with its own values. See `world`.
//!
//! **Its own rules** ([`TrainedModel`](crate::model::trained_model::TrainedModel)) are those of the
//! renderer `cuvol`: samples from the face of the outermost cells on, colours cut at 0 at each
//! sample, no upper limit, and rays end at a transmittance of `stop_thresh`.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod arguments;
mod arrays;
mod background;
mod keys;
mod lightning;
mod model;
mod nodes;
mod open;
mod spheres;
mod whole;
mod world;

pub use keys::{knows, takes_resolution};
pub use open::open_tensors;
