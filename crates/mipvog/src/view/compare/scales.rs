//! Errors of a field's pictures at every scale.

use serde::{Deserialize, Serialize};

use super::metrics::{self, Errors, Picture};
use super::{Reference, References};
use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use crate::view::render::Renderer;

/// Errors at one scale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ScaleErrors {
    /// Factor by which the full-size picture is reduced along each side; 1 is full size.
    pub scale: usize,
    /// Mean PSNR over the frames, each over all pixels and RGB, in dB; at most 200.
    pub psnr: f64,
    /// PSNR of the mean squared error over the pixels of all frames, in dB; at most 200. Gates use
    /// it, because blank or identical frames cannot hide a bad one.
    pub pooled_psnr: f64,
    /// Mean structural similarity over the frames, at most 1; null for pictures with fewer than 11
    /// pixels along a side.
    pub ssim: Option<f64>,
    /// Largest absolute error of any channel of any pixel, 0 to 1.
    pub max_abs: f64,
    /// 99th percentile of the absolute error over all channels and pixels, 0 to 1.
    pub p99_abs: f64,
    /// Number of frames.
    pub frames: usize,
    /// Mean PSNR without view-dependent colour, in dB; at most 200; null against photographs.
    pub psnr_diffuse: Option<f64>,
    /// Mean PSNR of opacity, which shows silhouettes, in dB; at most 200; null against pictures
    /// without alpha.
    pub psnr_opacity: Option<f64>,
    /// Mean level that samples of the field read; 0 is the finest. Above 0, the error includes that
    /// of coarser levels. Null if no frame shows anything.
    pub mean_level: Option<f64>,
    /// Names of the frames in which neither field nor reference shows anything.
    pub blank_frames: Vec<String>,
}

/// One frame at one scale: both pictures.
pub struct FrameErrors<'a> {
    /// Name of the camera.
    pub frame: &'a str,
    /// Factor by which the full-size picture is reduced along each side.
    pub scale: usize,
    /// Picture of the reference.
    pub want: &'a Picture,
    /// Picture of the field.
    pub got: &'a Picture,
}

/// Compares `field` with `reference` from all cameras at all scales; `visit` gets each frame.
pub fn compare(
    reference: &Reference,
    field: &Renderer,
    cameras: &[Camera],
    scales: &[usize],
    supersample: usize,
    progress: &dyn Progress,
    visit: impl FnMut(&FrameErrors) -> Result<()>,
) -> Result<Vec<ScaleErrors>> {
    References::new(reference, cameras, scales, supersample).compare(field, progress, visit)
}

impl References<'_> {
    /// Compares `field` with the reference from all cameras at all scales; `visit` gets each frame.
    /// The whole comparison is one [`Step::Render`].
    pub fn compare(
        &mut self,
        field: &Renderer,
        progress: &dyn Progress,
        mut visit: impl FnMut(&FrameErrors) -> Result<()>,
    ) -> Result<Vec<ScaleErrors>> {
        let scales = self.scales();
        let mut sums: Vec<Sums> = scales.iter().map(|_| Sums::default()).collect();
        progress.begin(Step::Render, self.work());
        for (number, camera) in self.cameras().iter().enumerate() {
            progress
                .part(Step::Render, &format!("picture {}/{}", number + 1, self.cameras().len()));
            let wanted = self.take(number, progress)?;
            for ((&scale, want), sums) in scales.iter().zip(&wanted).zip(&mut sums) {
                let small = Camera { lens: camera.lens.shrunk(scale), ..camera.clone() };
                let got = self.of_field(field, &small, progress)?;
                sums.add(&camera.name, want, &got);
                visit(&FrameErrors { frame: &camera.name, scale, want, got: &got })?;
            }
            self.put_back(number, wanted);
        }
        Ok(scales.iter().zip(sums).map(|(&scale, sums)| sums.finish(scale)).collect())
    }
}

/// Errors of several frames at one scale.
#[derive(Default)]
struct Sums {
    frames: usize,
    psnr: f64,
    ssim: Option<f64>,
    diffuse: Option<f64>,
    opacity: Option<f64>,
    errors: Errors,
    /// Sum and number of the squared differences.
    squares: (f64, usize),
    /// Sum of the mean levels, and number, of frames that are not blank.
    levels: (f64, usize),
    blank: Vec<String>,
}

impl Sums {
    fn add(&mut self, frame: &str, want: &Picture, got: &Picture) {
        let first = self.frames == 0;
        let add = |sum: &mut Option<f64>, value: Option<f64>| {
            let old = if first { Some(0.0) } else { *sum };
            *sum = old.zip(value).map(|(old, value)| old + value);
        };
        let (all_want, all_got) = (want.color.as_flattened(), got.color.as_flattened());
        let square = metrics::square_error(all_want, all_got);
        self.psnr += metrics::psnr_of(square, all_want.len());
        self.squares = (self.squares.0 + square, self.squares.1 + all_want.len());
        if let Some(level) = got.level {
            self.levels = (self.levels.0 + level, self.levels.1 + 1);
        }
        // Photographs may have no alpha.
        if got.is_blank() && (want.opacity.is_none() || want.is_blank()) {
            self.blank.push(frame.to_owned());
        }
        add(&mut self.ssim, metrics::ssim(want, got));
        let flat =
            |colors: &Option<Vec<[f32; 3]>>| colors.as_ref().map(|c| c.as_flattened().to_vec());
        let pair = flat(&want.diffuse).zip(flat(&got.diffuse));
        add(&mut self.diffuse, pair.map(|(want, got)| metrics::psnr(&want, &got)));
        let pair = want.opacity.as_ref().zip(got.opacity.as_ref());
        add(&mut self.opacity, pair.map(|(want, got)| metrics::psnr(want, got)));
        self.errors.add(all_want, all_got);
        self.frames += 1;
    }

    fn finish(self, scale: usize) -> ScaleErrors {
        let mean = |sum: f64| sum / self.frames.max(1) as f64;
        ScaleErrors {
            scale,
            psnr: mean(self.psnr),
            pooled_psnr: metrics::psnr_of(self.squares.0, self.squares.1),
            ssim: self.ssim.map(mean),
            max_abs: self.errors.largest(),
            p99_abs: self.errors.quantile(0.99),
            frames: self.frames,
            psnr_diffuse: self.diffuse.map(mean),
            psnr_opacity: self.opacity.map(mean),
            mean_level: (self.levels.1 > 0).then(|| self.levels.0 / self.levels.1 as f64),
            blank_frames: self.blank,
        }
    }
}
