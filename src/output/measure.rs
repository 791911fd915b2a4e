//! The distance of an export's pictures from those of its source.

use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use crate::output::format::Shown;
use crate::view::compare::metrics::psnr;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render, tiles};

/// The mean PSNR over cameras, in dB, one ray a pixel. The source's samples all read `level`.
/// [`Step::Render`] advances by tiles.
///
/// # Errors
///
/// Those of rendering, and a request to stop.
pub fn export_psnr(
    source: &Renderer,
    exported: &dyn Shown,
    cameras: &[Camera],
    level: usize,
    progress: &dyn Progress,
) -> Result<f64> {
    let work: u64 = cameras.iter().map(|camera| 2 * tiles(&camera.lens, 1)).sum();
    progress.begin(Step::Render, work);
    let mut sum = 0.0;
    for camera in cameras {
        let options = FrameOptions { levels: LevelChoice::Fixed(level), supersample: 1 };
        let frame = render(source, camera, &options, progress)?;
        let shown = |color: &[[f32; 3]]| -> Vec<f32> {
            color.as_flattened().iter().map(|value| value.clamp(0.0, 1.0)).collect()
        };
        sum += psnr(&shown(&frame.color), &shown(&exported.picture(camera, progress)?));
    }
    Ok(sum / cameras.len().max(1) as f64)
}
