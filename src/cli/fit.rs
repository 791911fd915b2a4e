//! Options of `--filter fit`.

use std::path::PathBuf;

use clap::Args;

use super::cameras::warn_of_cameras;
use super::common::Common;
use super::outcome::warn;
use crate::bake::fit::{FittedLevel, is_held_out};
use crate::bake::{BakeOptions, FitReport, Photographs};
use crate::base::error::{Error, Result};
use crate::model::camera::{self, Camera};
use crate::view::compare::shared_photograph;

/// Length and pictures of a fit.
#[derive(Debug, Args)]
#[command(next_help_heading = "Fit")]
pub struct FitArguments {
    /// Maximum number of steps of `--filter fit` [default: 130, or 1500 with --photographs]
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u32).range(1..))]
    fit_steps: Option<u32>,
    /// Time limit of `--filter fit` in seconds, including its reference pictures. The output then
    /// depends on the machine [default: unlimited]
    #[arg(long, value_name = "SECONDS")]
    fit_seconds: Option<f64>,
    /// Camera file for the reference pictures of `--filter fit`; a gate must use other cameras
    /// [default: spheres around the box]
    #[arg(long, value_name = "FILE")]
    fit_cameras: Option<PathBuf>,
    /// Folder of photographs for `--filter fit` to fit coarser levels to, instead of renders of
    /// level 0; taken from --fit-cameras or else --cameras. One in eight is held out
    #[arg(long, value_name = "DIR")]
    photographs: Option<PathBuf>,
}

/// Minimum number of photographs for holding one out.
const FEWEST_PHOTOGRAPHS: usize = 8;

/// Steps of a fit to photographs. Levels start farther from photographs than from pictures of level
/// 0: at 1/8, this many steps gain 1.5 dB over the number for such pictures.
const PHOTOGRAPH_STEPS: usize = 1500;

impl FitArguments {
    /// The camera file, if there is one.
    pub fn camera_file(&self) -> Option<PathBuf> {
        self.fit_cameras.clone()
    }

    /// True if any of these options is given.
    pub fn given(&self) -> bool {
        self.fit_steps.is_some()
            || self.fit_seconds.is_some()
            || self.fit_cameras.is_some()
            || self.photographs.is_some()
    }

    /// The cameras that may judge the fit: where photographs are those of `--cameras`, the ones
    /// that are held out.
    pub fn judges(&self, mut cameras: Vec<Camera>) -> Vec<Camera> {
        if self.photographs.is_some() && self.fit_cameras.is_none() {
            let mut numbers = 0..;
            cameras.retain(|_| numbers.next().is_some_and(is_held_out));
        }
        cameras
    }

    /// Explicit numbers override the preset's.
    pub fn apply_numbers(&self, options: &mut BakeOptions) {
        options.fit_steps = self.fit_steps.map_or(options.fit_steps, |steps| steps as usize);
        options.fit_seconds = self.fit_seconds.or(options.fit_seconds);
    }

    /// All explicit options override the preset's. `cameras` are those of `--cameras`, for
    /// photographs alone.
    pub fn apply(
        &self,
        options: &mut BakeOptions,
        cameras: impl FnOnce() -> Result<Option<Vec<Camera>>>,
        common: &Common,
    ) -> Result<()> {
        self.apply_numbers(options);
        if let Some(path) = &self.fit_cameras {
            let picked = camera::read(path, None, &common.limits())?.pick(&[])?;
            warn_of_cameras(path, &picked, common);
            options.fit_cameras = picked.cameras;
        }
        let photographs = self.photographs.as_ref().filter(|_| options.filter.is_fitted());
        if let Some(folder) = photographs {
            if self.fit_cameras.is_none() {
                options.fit_cameras = cameras()?.ok_or_else(|| {
                    Error::usage(
                        "--photographs needs --fit-cameras or --cameras to tell from where",
                    )
                })?;
            }
            if options.fit_cameras.len() < FEWEST_PHOTOGRAPHS {
                let found = options.fit_cameras.len();
                return Err(Error::usage(format!(
                    "--photographs needs {FEWEST_PHOTOGRAPHS} cameras or more, because one in eight \
                     is held out; there are {found}"
                )));
            }
            if let Some(message) = shared_photograph(folder, &options.fit_cameras) {
                warn(&message, common);
            }
            options.photographs = Some(Photographs::of(folder, &options.fit_cameras)?);
            if self.fit_steps.is_none() {
                options.fit_steps = PHOTOGRAPH_STEPS;
            }
        }
        Ok(())
    }
}

/// Warns of levels that a fit reverted.
pub fn warn_of_idle_levels(fitted: &FitReport, common: &Common) {
    for FittedLevel { level, steps, psnr_before, psnr_after, kept } in &fitted.levels {
        if *steps == 0 {
            let message = "took no step before the fit ended, so it stays as in rate-tent";
            warn(&format!("level {level} {message}"), common);
        } else if !kept {
            let message = "is kept from rate-tent: the fitted version was worse at some scale";
            warn(&format!("level {level} {message}"), common);
        } else if let (Some(before), Some(after)) = (psnr_before, psnr_after)
            && after <= before
        {
            let message = format!("gained nothing in {steps} steps at {before:.2} dB");
            warn(&format!("level {level} {message}"), common);
        }
    }
}

/// Refuses to measure a fit with the cameras that it was fitted to.
pub fn check_judges(options: &BakeOptions, judges: &[Camera]) -> Result<()> {
    // All photographs are used, and the same ones are held out.
    let holds_out = options.photographs.is_some();
    let fitted = options.fit_cameras.iter().enumerate();
    let fitted: Vec<_> =
        fitted.filter(|(number, _)| !(holds_out && is_held_out(*number))).collect();
    let known = |judge: &&Camera| fitted.iter().any(|(_, one)| one.to_world == judge.to_world);
    match judges.iter().find(known) {
        Some(judge) => Err(Error::usage(format!(
            "frame {} of --cameras is among --fit-cameras: levels must be judged from places that \
             they were not fitted to",
            judge.name
        ))),
        None => Ok(()),
    }
}
