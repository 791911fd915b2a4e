//! What a bake keeps, fits and leaves out.

mod coverage;
mod direction;
mod fill;
mod importance;
mod max_error;
pub mod nested;
mod nested_edit;
mod required;
mod sweep;
