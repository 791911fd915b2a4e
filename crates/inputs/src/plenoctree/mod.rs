//! PlenOctrees, as svox writes them (`tree.npz`), compressed by plenoctree's script, or in a draw
//! list of nerfvis and volrend, where a name and two underscores stand before each key.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | `child` | i32 `[n, 2, 2, 2]` | 0 is a leaf; else the child's number less the node's own |
//! | `data` | `[n, 2, 2, 2, D]` | of a leaf: colours, all functions of red, of green, of blue; then density per world unit |
//! | `sigma`, `quant_map`, `quant_colors`, `data_retained` | | in place of `data`: density, numbers of colours in a code book for each function, and the first functions as they are |
//! | `invradius3`, `offset` | `[3]` | tree = offset + x invradius3; the tree spans 0 to 1 |
//! | `data_format` | | `SH9` and so on, `SG25` and so on, `RGBA` |
//! | `extra_data` | `[B, 4]` | sharpness and axis of each spherical Gaussian |
//!
//! **Its own rules** are those of svox: a leaf is one value, without interpolation; each leaf that
//! a ray crosses adds the optical depth of its chord and of [`MORE_LENGTH`], and the logistic
//! function of its sum of functions. Rays never end early. svox's own cameras have no half pixel;
//! this program's rays go through the middle of pixels.
//!
//! **The field.** Every leaf is resampled at the middle of the deepest level's cells, and the field
//! is linear between these, so surfaces are blurred by up to a cell; a bake states the loss.
//! Coefficients are logits, clamped by a sigmoid at each sample. Leaves of density 0 have no
//! colour; next to others, they take the mean of their neighbours' coefficients, because edges
//! would otherwise fade to grey. Spherical Gaussians become harmonics of degree 3, by least squares
//! over the sphere; harmonics of degree 4 lose their last band.
//!
//! Asymmetric Gaussians (`ASG`) and trees with more than 8 children per node are refused.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod basis;
mod keys;
mod model;
mod open;
mod quantized;
mod tree;

pub use keys::knows;
pub use model::MORE_LENGTH;
pub use open::open_tensors;
