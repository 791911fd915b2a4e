//! Written splats, rendered by the rules of their programs.

use super::project::{GaussianSplat, Rules};
use super::raster::rasterize;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::format::Shown;
use crate::model::camera::Camera;

/// Splats that were read back.
#[derive(Debug)]
pub(super) struct ShownSplats {
    pub(super) splats: Vec<GaussianSplat>,
    pub(super) rules: Rules,
    pub(super) background: [f32; 3],
}

impl Shown for ShownSplats {
    fn picture(&self, camera: &Camera, progress: &dyn Progress) -> Result<Vec<[f32; 3]>> {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        Ok(rasterize(&self.splats, camera, self.background, self.rules)?.color)
    }
}
