//! The distance of an export's pictures from those of its source.

use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::format::Shown;
use crate::model::camera::Camera;
use crate::view::compare::metrics::{psnr_of, square_error};
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render, tiles};

/// The distance of an export's pictures, in dB, at most 200.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExportErrors {
    /// The mean over cameras.
    pub psnr: f64,
    /// Of the mean square error over the pixels of all cameras, which gates use.
    pub pooled_psnr: f64,
}

/// The distance of an export from its source, one ray per pixel. All samples of the source read
/// `level`. [`Step::Render`] advances by tiles.
///
/// # Errors
///
/// Errors of rendering, and a request to stop.
pub fn export_errors(
    source: &Renderer,
    exported: &dyn Shown,
    cameras: &[Camera],
    level: usize,
    progress: &dyn Progress,
) -> Result<ExportErrors> {
    let work: u64 = cameras.iter().map(|camera| 2 * tiles(&camera.lens, 1)).sum();
    progress.begin(Step::Render, work);
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0);
    for camera in cameras {
        let options = FrameOptions { levels: LevelChoice::Fixed(level), supersample: 1 };
        let frame = render(source, camera, &options, progress)?;
        let shown = |color: &[[f32; 3]]| -> Vec<f32> {
            color.as_flattened().iter().map(|value| value.clamp(0.0, 1.0)).collect()
        };
        let own = shown(&frame.color);
        let square = square_error(&own, &shown(&exported.picture(camera, progress)?));
        sum += psnr_of(square, own.len());
        (squares, count) = (squares + square, count + own.len());
    }
    let psnr = sum / cameras.len().max(1) as f64;
    Ok(ExportErrors { psnr, pooled_psnr: psnr_of(squares, count) })
}
