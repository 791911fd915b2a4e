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
    /// Steps for each level, at most.
    pub steps: usize,
    /// Seconds in all; none is without bound. Levels share evenly those that the targets leave, and
    /// a level leaves what it does not need to the next ones. The result of a bounded fit depends on
    /// the machine.
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
    /// PSNR of the validation rays before the fit, in dB.
    pub psnr_before: f64,
    /// The same after the fit.
    pub psnr_after: f64,
}

/// The end of one level's fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// After its last step, or because nothing was gained any more.
    Reached,
    /// Its share of the time was up.
    OutOfTime,
    /// The caller has enough, of this level and of those that follow.
    Enough,
}

/// Inputs of the fits of all levels.
pub struct FitContext<'a> {
    pub targets: &'a Targets,
    pub retained: &'a [&'a NodeMask],
    pub options: &'a FitOptions<'a>,
    /// The rule that levels are fitted under.
    pub start: LevelOfDetail,
    pub clock: Instant,
    /// Seconds that the targets took.
    pub before: f64,
    pub progress: &'a dyn Progress,
}

/// PSNR of a mean squared error, in dB.
pub fn psnr(mean_square: f64) -> f64 {
    -10.0 * libm::log10(mean_square.max(1e-12))
}
