//! Reading fields between nodes.
//!
//! [`Sample`] is what a renderer sees of a field: values at positions of a level, and where nothing
//! is to be seen. It has two implementations, [`Dense`] for a field as trained and [`Sparse`] for a
//! baked one, over the same arrays: a level's density, its colours interleaved node by node, and a
//! rule that finds the lowest node of a position's cell. Colours have `C` lanes, unused ones zero,
//! so that interpolating them is a handful of vector instructions.
//!
//! What is interpolated is what the level holds; of raw density what the activation's order says: raw
//! density, density or opacity.

mod dense;
mod field;
mod level;
mod skip;
mod sparse;
mod stored;

pub use dense::{Dense, Levels};
pub use field::Sample;
pub use level::Cell;
use level::interpolated_density;
pub use skip::{Macro, SkipGrid};
pub use sparse::Sparse;
pub use stored::Stored;
