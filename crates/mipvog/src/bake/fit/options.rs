//! Options of a fit.

use std::path::Path;

use crate::model::camera::Camera;

/// The length of a fit, and its cameras.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions<'a> {
    /// Steps, at most, each of which moves all levels.
    pub steps: usize,
    /// Time limit in seconds; none is unlimited. The result of a bounded fit depends on the
    /// machine.
    pub seconds: Option<f64>,
    /// Cameras of the target pictures; without any, spheres around the box.
    pub cameras: &'a [Camera],
    /// A folder of the cameras' photographs, which levels are fitted to in place of level 0.
    pub photographs: Option<&'a Path>,
}
