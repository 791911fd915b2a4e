//! What the fits of all levels share.

use std::time::Instant;

use serde::Serialize;

use super::target::Targets;
use crate::base::progress::Progress;
use crate::model::baked::LevelOfDetail;
use crate::model::camera::Camera;
use crate::model::grid::NodeMask;

/// How much to fit, and to what.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions<'a> {
    /// Steps for each level, at most.
    pub steps: usize,
    /// Seconds in all, targets included; none is without bound. What comes out then depends on the
    /// machine.
    pub seconds: Option<f64>,
    /// Where pictures are taken from; without any, spheres around the box.
    pub cameras: &'a [Camera],
}

/// What the fit of one level did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FittedLevel {
    /// Which one.
    pub level: usize,
    /// Steps that were taken.
    pub steps: usize,
    /// PSNR of rays that no step uses, in dB, before.
    pub psnr_before: f64,
    /// And after.
    pub psnr_after: f64,
}

/// What all levels' fits share.
pub struct FitContext<'a> {
    pub targets: &'a Targets,
    pub needed: &'a [&'a NodeMask],
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
