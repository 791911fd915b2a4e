//! The cost of a sweep and the sizes of its containers, without baking them.

use std::path::Path;

use serde::Serialize;

use super::measure::Baking;
use super::options::SweepOptions;
use super::record::{self, Basis};
use super::run::ends_sweep;
use crate::bake::{Preset, forecast};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use mipvog_inputs::Source;

/// The forecast of one setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SettingForecast {
    /// Name of the setting.
    pub name: String,
    /// Equivalent preset, if the sweep was asked for one.
    pub preset: Option<&'static str>,
    /// True if an earlier sweep has the result. Size and time are then measured, not forecast.
    pub resumed: bool,
    /// Size of the container in bytes; null if the bake fails.
    pub output_bytes: Option<u64>,
    /// Wall-clock time of one bake in seconds; null if the bake fails or fits levels.
    pub seconds: Option<f64>,
    /// Error message, if the setting cannot be baked.
    pub failure: Option<String>,
}

/// The forecast of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SweepForecast {
    /// File name of the input.
    pub input: String,
    /// Number of bakes per setting.
    pub repeat: usize,
    /// Number of threads that would bake.
    pub threads: usize,
    /// Total size of all containers in bytes.
    pub output_bytes: u64,
    /// Total wall-clock time of the remaining bakes in seconds, without rendering; null if one of
    /// them has no forecast.
    pub seconds: Option<f64>,
    /// The settings, in the order of the request.
    pub settings: Vec<SettingForecast>,
}

/// Forecasts [`super::sweep`]; writes nothing.
///
/// # Errors
/// The input cannot be read, or the caller cancels. A setting that cannot be baked is reported.
pub fn forecast_sweep(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<SweepForecast> {
    let basis = Basis::new(source, cameras, options)?;
    progress.begin(Step::Sweep, options.settings.len() as u64);
    let mut settings = Vec::with_capacity(options.settings.len());
    for (number, setting) in options.settings.iter().enumerate() {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let part =
            format!("setting {} of {}: {}", number + 1, options.settings.len(), setting.name);
        progress.part(Step::Sweep, &part);
        let digest = basis.digest(setting);
        let found = record::finished(folder, setting, &digest, &options.limits);
        let mut told = SettingForecast {
            name: setting.name.clone(),
            preset: setting.preset.map(Preset::name),
            resumed: found.is_some(),
            output_bytes: found.as_ref().map(|(found, _)| found.output_bytes),
            seconds: found.as_ref().map(|(found, _)| found.seconds),
            failure: None,
        };
        if found.is_none() {
            let mut bake = setting.options.clone();
            bake.limits = options.limits.clone();
            match forecast(&source.field, &bake, &Baking(progress)) {
                Ok(forecast) => {
                    told.output_bytes = Some(forecast.report.output_bytes);
                    told.seconds = forecast.seconds;
                }
                Err(error) if ends_sweep(&error) => return Err(error),
                Err(error) => told.failure = Some(error.to_string()),
            }
        }
        settings.push(told);
        progress.advance(Step::Sweep, 1);
    }
    let name = source.file.path().file_name().unwrap_or_default();
    let missing = settings.iter().filter(|told| !told.resumed && told.failure.is_none());
    let seconds: Option<f64> = missing.map(|told| told.seconds).sum();
    Ok(SweepForecast {
        input: name.to_string_lossy().into_owned(),
        repeat: options.repeat,
        threads: parallel::threads(),
        output_bytes: settings.iter().filter_map(|told| told.output_bytes).sum(),
        // An empty sum is -0.
        seconds: seconds.map(|seconds| seconds * options.repeat as f64 + 0.0),
        settings,
    })
}
