//! Reading fields between nodes.
//!
//! A renderer reads a field through [`Sample`]: values at positions of a level, and empty space.
//! There are two implementations, [`Dense`] for a field as trained and [`Sparse`] for a baked one.
//! Both have the same arrays: a level's density, and its colours interleaved node by node. Each
//! finds the lowest node of a position's cell in its own way. Colours have `C` lanes, so that
//! interpolating them is a handful of vector instructions. Lanes without a channel are zero.
//!
//! Stored values are interpolated. Raw density is interpolated in the form that the activation's
//! order names: raw density, density or opacity.

mod dense;
mod field;
mod level;
mod skip;
mod sparse;
mod stored;

pub use dense::{Dense, NodesMut};
pub use field::Sample;
pub use level::Cell;
use level::interpolated_density;
pub use skip::{Macro, SkipGrid};
pub use sparse::Sparse;
pub use stored::Stored;
