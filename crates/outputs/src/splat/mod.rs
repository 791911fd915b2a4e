//! Gaussian splats: a `.ply` with harmonics of degree 3, as viewers and converters of splats read
//! it.
//!
//! Splats are round, and seen by the rules of their renderers ([`raster`]): projected to the
//! picture as an ellipse, widened by 0.3 square pixels, sorted by depth, composited from front to
//! back. They are made in four steps:
//!
//! 1. [`place`] puts one at each point of the lattice that lies at a surface or in fog, with the
//!    field's opacity, and its colours from all around as harmonics;
//! 2. pictures of the field from around the box, or from given cameras, are the targets;
//! 3. splats that show in no picture go, and beyond `--splats N` those that show least;
//! 4. [`optimize`] moves each within its cell, and changes size, opacity and colours, by Adam along
//!    the derivatives of the mean square error.
//!
//! Everything is float32 in an order that threads do not change, without library functions that
//! differ between machines: the same bytes everywhere.

mod format;
mod optimize;
mod place;
mod ply;
mod project;
mod raster;
mod shown;

pub use format::Splat;
pub use optimize::differentiate;
pub use project::{GaussianSplat, PARAMETERS};
pub use raster::{Picture, rasterize};
