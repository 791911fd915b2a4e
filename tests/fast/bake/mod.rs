//! What a bake keeps, fits and leaves out.

mod coverage;
mod direction;
mod fill;
mod importance;
mod max_error;
mod nested;
mod required;
mod sweep;
