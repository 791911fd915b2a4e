//! Inputs and results of the fits of all levels.

use std::time::Instant;

use serde::Serialize;

use super::target::Targets;
use crate::base::progress::Progress;
use crate::model::baked::LevelOfDetail;
use crate::model::camera::Camera;
use crate::model::grid::NodeMask;

/// The length of a fit, and its cameras.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions<'a> {
    /// Steps, at most, each of which moves all levels.
    pub steps: usize,
    /// Seconds in all; none is without bound. The result of a bounded fit depends on the machine.
    pub seconds: Option<f64>,
    /// Cameras of the target pictures; without any, spheres around the box.
    pub cameras: &'a [Camera],
}

/// The course of one level's fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FittedLevel {
    /// The level's number; 0 is the finest.
    pub level: usize,
    /// Steps that were taken.
    pub steps: usize,
    /// PSNR of rays of pictures that no step uses, each of as many pixels as a picture
    /// `2^level` times smaller has: of the levels of `rate-tent`, in dB.
    pub psnr_before: f64,
    /// The same after the fit.
    pub psnr_after: f64,
    /// False where the level is as `rate-tent` makes it, because a scale would look worse else.
    pub kept: bool,
}

/// Inputs of the fits of all levels.
pub struct FitContext<'a> {
    pub targets: &'a Targets,
    pub retained: &'a [&'a NodeMask],
    pub options: &'a FitOptions<'a>,
    /// The rule that levels are fitted under.
    pub start: LevelOfDetail,
    pub clock: Instant,
    pub progress: &'a dyn Progress,
}

/// PSNR of a mean squared error, in dB.
pub fn psnr(mean_square: f64) -> f64 {
    -10.0 * libm::log10(mean_square.max(1e-12))
}
