//! Reading fields between nodes.
//!
//! A renderer reads a field through [`SampleLevels`]: values at positions of a level, and empty
//! space. [`Sparse`] implements it for baked fields; the crate `mipvog` for trained ones. Both have
//! the same arrays: a level's density, and its colours interleaved node by node. They differ in
//! finding the lowest node of a position's cell. Colours have `C` lanes, so that interpolating them
//! takes a few vector instructions. Lanes without a channel are zero.
//!
//! Stored values are interpolated. The activation's order decides the form of interpolated density:
//! raw density, density or opacity.

mod depth;
mod field;
pub mod free_cells;
mod level;
mod point;
mod sampler;
mod skip;
mod skip_distance;
mod sparse;
mod view;

pub use depth::{optical_depth, raw_depth};
pub use field::SampleLevels;
pub use level::{Cell, Values, interpolated_density, split};
pub use point::{Sample, brightness, depth, depths, is_sampled, on_faces, sample_at, world_of};
pub use sampler::{Sampler, check_level};
pub use skip::{CellPlace, Macro, OccupiedMacroCells, SkipGrid};
pub use sparse::Sparse;
pub use view::View;
