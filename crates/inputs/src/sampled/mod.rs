//! Sampled arrays: density and colour from the user's own code.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | `density` | `[X, Y, Z]` | density per world unit, linear between nodes, cut at 0 after that |
//! | `aabb` | `[2, 3]` | the box; the outermost nodes lie on its faces |
//! | `sh` | `[X, Y, Z, 3, B]` | harmonics, `B` of 1, 4, 9 or 16: see [`crate::model::harmonics`] |
//! | `color` | `[X, Y, Z, 3]` | in place of `sh`: colours that do not depend on the view, 0 to 1 |
//! | `offset` | | added to the sum of harmonics (default 0.5) |
//! | `clamp` | | `zero`, `none` or `sigmoid` of that, at each sample (default `zero`) |
//! | `stepsize` | | distance of samples in voxels (default 0.5) |
//! | `background` | `[3]` | the colour behind the field (white) |
//! | `blocks` | `[n, 3]` | numbers of blocks along x, y and z; arrays are then `[n, b, b, b, ...]` |
//! | `block_size` | | `b`, nodes along a block's edge |
//! | `dimensions` | `[3]` | X, Y and Z of a file of blocks [as far as the blocks reach] |
//!
//! Outer boxes have the same arrays, with the prefixes `level1.`, `level2.` and so on. A file with
//! outer boxes is rendered by the rules of a field.
//!
//! Block `(i, j, k)` holds nodes `i b` to `(i + 1) b - 1` along x, and so on. Nodes outside of all
//! blocks have density 0 and coefficients 0. In a `.safetensors` file, `__metadata__` may hold
//! numbers and texts instead.
//!
//! **Its own rules** are a container's: samples from the face of the box on, `stepsize` node
//! spacings apart, all of which add colour. Colours are clamped at each sample; a baked field
//! clamps `zero` once per ray, which is equivalent if no visible sample is below 0.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod keys;
mod model;
mod open;

pub use keys::knows;
pub use open::open_tensors;
