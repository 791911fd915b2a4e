//! What a bake keeps, fits and leaves out.

#[path = "../common/mod.rs"]
mod common;

mod coverage;
mod direction;
mod fill;
mod fit;
mod importance;
mod max_error;
mod required;
mod sweep;
mod view_fit;
