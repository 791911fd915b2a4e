//! Errors of a field's pictures against another field's, or against photographs, at every scale.
//!
//! The reference is rendered at full size (supersampled on request), clamped to 0 to 1 as an 8-bit
//! picture would be, and box-downsampled in the colour space of training. The field is rendered at
//! each scale with one ray per pixel, and clamped. [`metrics`] has the error metrics and
//! [`Reference`] makes the reference pictures, which [`References`] caches for comparisons of
//! several fields.

mod directions;
pub mod metrics;
mod reference;
mod references;
mod scales;

pub use directions::{DirectionErrors, compare_directions};
pub use metrics::{Errors, Picture};
pub use reference::{Reference, photograph, photograph_file, shared_photograph};
pub use references::References;
pub use scales::{FrameErrors, ScaleErrors, compare};
