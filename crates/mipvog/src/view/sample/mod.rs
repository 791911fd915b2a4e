//! Reading fields between nodes: [`Dense`] for a field as trained, beside what the format's crate
//! has for a baked one.

mod dense;
mod stored;

pub use dense::{Dense, NodesMut};
pub use mipvog_format::sample::*;
pub use stored::Stored;
