//! The quality gate of `bake`: it measures the container's pictures before the file gets its name.

use std::path::Path;

use clap::Args;
use serde::Serialize;

use super::bake::short_name;
use super::cameras::{CameraArguments, CameraSource};
use super::common::Common;
use super::compare::errors_text;
use super::outcome::counted;
use super::progress::Bar;
use crate::base::error::{Error, Result};
use crate::model::camera::Camera;
use crate::model::field::RadianceField;
use crate::view::compare::{Reference, ScaleErrors, compare};
use crate::view::render::Renderer;

/// Scales at which the error is told, as far as pictures have that many pixels.
const SCALES: [usize; 4] = [1, 2, 4, 8];

/// From where, and how much error is allowed.
#[derive(Debug, Args)]
pub struct GateArguments {
    #[command(flatten, next_help_heading = "Cameras")]
    cameras: CameraArguments,
    /// Write nothing and exit with 1 if the PSNR in dB against the unbaked scene is below this; at
    /// full size, over the pixels of all cameras
    #[arg(long, value_name = "DB", help_heading = "Quality gate")]
    require_psnr: Option<f64>,
    /// Write nothing and exit with 1 if the PSNR in dB of fitted colours is below this; against the
    /// model's, in held-out directions
    #[arg(long, value_name = "DB", help_heading = "Quality gate")]
    require_view_psnr: Option<f64>,
}

/// The errors of the cameras' pictures, and the verdict of the quality gate.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct GateReport {
    /// Errors against the unbaked scene at one ray per pixel, one entry per scale.
    pub errors: Vec<ScaleErrors>,
    /// Required pooled PSNR at full size in dB; null if none is required.
    pub required_psnr: Option<f64>,
    /// True if the required PSNR is reached or none is required.
    pub passed: bool,
}

impl GateArguments {
    /// True if there are cameras to measure from. Refuses a gate without them.
    pub fn measures(&self) -> Result<bool> {
        let given = self.cameras.given();
        if self.require_view_psnr.is_some_and(|least| !least.is_finite()) {
            return Err(Error::usage("--require-view-psnr must be a finite number of dB"));
        }
        match self.require_psnr {
            Some(_) if !given => {
                Err(Error::usage("--require-psnr needs --cameras or --turntable to measure from"))
            }
            Some(least) if !least.is_finite() => {
                Err(Error::usage("--require-psnr must be a finite number of dB"))
            }
            _ if !given && self.cameras.selects() => {
                Err(Error::usage("--size and --frames need --cameras or --turntable"))
            }
            _ => Ok(given),
        }
    }

    /// The least PSNR of fitted colours.
    pub const fn required_view_psnr(&self) -> Option<f64> {
        self.require_view_psnr
    }

    /// The camera file, if there is one.
    pub fn camera_file(&self) -> Option<CameraSource> {
        self.cameras.file()
    }

    /// The cameras, read before a long bake could be wasted on a bad camera file.
    pub fn cameras(&self, field: &RadianceField, common: &Common) -> Result<Vec<Camera>> {
        self.cameras.cameras(&field.scene.bounds, common)
    }

    /// The cameras of a file, if there is one.
    pub fn cameras_of_file(&self, common: &Common) -> Result<Option<Vec<Camera>>> {
        self.cameras.of_file(common)
    }

    /// Compares a container with the input it was baked from.
    pub fn measure(
        &self,
        reference: &Reference,
        baked: &Renderer,
        cameras: &[Camera],
        bar: &Bar,
    ) -> Result<GateReport> {
        let sides = cameras.iter().flat_map(|camera| [camera.lens.width, camera.lens.height]);
        let smallest = sides.min().unwrap_or(0);
        let scales: Vec<usize> = SCALES.into_iter().filter(|&scale| scale <= smallest).collect();
        let errors = compare(reference, baked, cameras, &scales, 1, bar, |_| Ok(()))?;
        // Blank frames are equal for any field.
        let judges = |full: &ScaleErrors| full.blank_frames.len() < cameras.len();
        let reached =
            |least| errors.first().is_some_and(|full| judges(full) && full.pooled_psnr >= least);
        let passed = self.require_psnr.is_none_or(reached);
        Ok(GateReport { errors, required_psnr: self.require_psnr, passed })
    }
}

impl GateReport {
    /// For people, of a container that was baked from `input`.
    pub fn text(&self, input: &Path) -> String {
        let input = short_name(input);
        let frames = self.errors.first().map_or(0, |full| full.frames);
        let mut text = format!("  against {input}, {}:\n", counted(frames, "picture"));
        text += &errors_text(&self.errors);
        if let Some(least) = self.required_psnr.filter(|_| self.passed) {
            text += &format!("  gate passed: at least {least} dB at full size, pooled\n");
        }
        text
    }

    /// The reason why the container at `output` was not written, if the gate was missed.
    pub fn failure(&self, output: &Path) -> Option<String> {
        let least = self.required_psnr.filter(|_| !self.passed)?;
        let psnr = self.errors.first().map_or(0.0, |full| full.pooled_psnr);
        let output = output.display();
        if psnr >= least {
            return Some(format!("{output}: not written: nothing shows in any frame of the gate"));
        }
        Some(format!("{output}: not written: {psnr:.2} dB at full size, {least} dB required"))
    }
}
