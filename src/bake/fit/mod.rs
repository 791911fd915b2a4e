//! Coarser levels, fitted to pictures of level 0.
//!
//! A filter knows neither that a ray sees the front of things, nor how thick opaque regions are
//! along the ray. So a fit starts from the levels of `rate-tent` and changes them until their
//! pictures are right:
//!
//! 1. [`target`] renders level 0, from given cameras or from spheres around the box, and
//!    box-downsamples the pictures.
//! 2. [`gradient`] renders single rays of the small pictures, one ray a pixel. It differentiates
//!    their colour by the level's values: through the view network, compositing, blending of
//!    levels, activation and interpolation.
//! 3. [`adam`] takes steps.
//! 4. [`level_fit`] fits one level, with the finer ones as they are by then. It measures
//!    *validation rays*, which no step uses, keeps the best state and ends when the fit has
//!    stalled.
//! 5. [`rule`] moves the level-of-detail rule to where the fitted levels look best.
//!
//! Only visible nodes change. The budget is in steps, rays are drawn by a fixed generator, and sums
//! of gradients are in a fixed order. So the same bytes come out for any number of threads. A fit
//! can be cut short by a time limit or by the caller; the report then has fewer steps.

mod adam;
mod context;
mod gradient;
mod level_fit;
mod rule;
mod run;
mod target;

pub use context::{FitOptions, FittedLevel};
pub use run::{Fitted, fit};
