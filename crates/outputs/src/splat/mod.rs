//! Gaussian splats with harmonics of degree 3, as files that viewers and converters of splats read:
//! `.ply`, `.spz` and glTF ([`files`]).
//!
//! Splats are round, and seen by the rules of their renderers ([`raster`]): projected to the
//! picture as an ellipse, widened by 0.3 square pixels, sorted by depth, composited from front to
//! back. Five steps make them:
//!
//! 1. [`place`] puts a splat at each lattice point at a surface or in fog, with the field's
//!    opacity; each nested box has its own lattice, and splats as large as its spacing;
//! 2. pictures of the field from around the box, from inside a world, or from given cameras, are
//!    the [`targets`];
//! 3. splats that are visible in no picture are removed, and beyond `--splats N` the least visible
//!    ones;
//! 4. the others get the field's colours from all around as harmonics;
//! 5. [`optimize`] moves each within its cell, and changes size, opacity and colours, by Adam along
//!    the derivatives of the mean square error.
//!
//! All arithmetic is float32 in an order that does not depend on threads, without library functions
//! that differ between machines, so the bytes are the same everywhere.

mod axes;
mod files;
mod format;
mod gltf;
mod optimize;
mod place;
mod ply;
mod project;
mod raster;
mod shown;
mod spz;
mod targets;
mod tile;

pub use files::{FileKind, Origin};
pub use format::Splat;
pub use optimize::differentiate;
pub use project::{GaussianSplat, PARAMETERS, Rules};
pub use raster::{Picture, rasterize};
