//! Values of fields between nodes: [`Dense`] for a trained field; the format's crate has its
//! counterpart for a baked one.

mod dense;
mod stored;

pub use dense::{Dense, NodesMut};
pub use mipvog_format::sample::*;
pub use stored::Stored;
