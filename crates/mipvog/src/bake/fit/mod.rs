//! Coarser levels, fitted to pictures of level 0.
//!
//! A filter ignores that a ray sees only front surfaces, and how thick opaque regions are along the
//! ray. So a fit starts from the levels of `rate-tent` and changes them until their pictures are
//! right:
//!
//! 1. [`target`] renders level 0, from given cameras or from spheres around the box. The mean of a
//!    window of pixels is a pixel of a smaller picture.
//! 2. [`morton_pixels`] spreads the rays of a step evenly over the visible surface.
//! 3. Levels get anisotropy ([`crate::model::anisotropy`]) and, if colours are logits, directional
//!    brightness ([`crate::model::directional`]). Both start at 0.
//! 4. [`curve`] is the rule that picks the level of a sample.
//! 5. [`trace`] renders single rays of the small pictures, one ray per pixel. [`gradient`]
//!    differentiates their colour by the values of all levels and by the knots of the curve:
//!    through the view network, compositing, blending of levels, activation and interpolation.
//! 6. [`adam`] takes steps. [`moments`] computes their lengths from the derivatives so far.
//! 7. [`joint_fit`] takes steps with rays of all scales. It measures the [`quality`] of rays of
//!    pictures that no step uses, keeps the best state, and shortens steps sooner when the fit has
//!    stalled. If a fit is worse than the filter's levels at any scale, one or all of its levels
//!    are reverted.
//!
//! Only visible nodes change. The budget is in steps, rays are drawn by a fixed generator, and sums
//! of gradients are in a fixed order. So the output does not depend on the number of threads. A fit
//! can be cut short by a time limit or by the caller; the report then has fewer steps.

mod adam;
mod context;
mod curve;
#[cfg(test)]
mod derivatives;
mod finest;
mod gradient;
mod joint_fit;
mod moments;
mod morton_pixels;
mod options;
mod quality;
mod run;
mod summed_area;
mod target;
mod trace;

pub use context::{Fitted, FittedLevel};
pub use options::FitOptions;
pub use run::fit;
pub use target::is_held_out;
