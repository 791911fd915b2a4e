//! Coarser levels, fitted to what they should look like.
//!
//! A filter does not know that a ray sees the front of things, nor how thick matter looks along it.
//! So after `rate-tent` has made the levels, their pictures are compared with what they stand for:
//! [`target`] renders level 0 from cameras on spheres around the box, or from given ones, and
//! box-downsamples the pictures; [`gradient`] renders single rays of the small pictures, one ray a
//! pixel, and differentiates their colour by what the level holds (through the view network,
//! compositing, blending of levels, activation and interpolation); [`adam`] takes steps. [`course`]
//! fits levels finest to coarsest, each with the finer ones as they are then, watches rays that no
//! step uses, keeps the best state and ends where nothing is gained any more. Only nodes that can be
//! seen change. Last, [`rule`] moves the level-of-detail rule to where the fitted levels look best.
//!
//! The budget is in steps, rays are drawn by a fixed generator and sums of gradients are in a fixed
//! order, so that the same bytes come out for any number of threads. A fit that is cut short, by
//! seconds or because somebody asked for what there is, says how many steps it took.

mod adam;
mod context;
mod course;
mod gradient;
mod rule;
mod run;
mod target;

pub use context::{FitOptions, FittedLevel};
pub use run::{Fitted, fit};
