//! The report of a sweep. Programs read the JSON; [`super::csv`] and [`super::page`] print it.

use serde::{Deserialize, Serialize};

use super::pareto::{Point, front, knee};
use super::setting::Setting;
use super::thumbnail::Thumbnail;
use crate::bake::Preset;
use crate::view::compare::ScaleErrors;

/// The figures and the thumbnail of a setting, or the reason for its failure.
pub(super) type Outcome = std::result::Result<(Measured, Option<Thumbnail>), String>;

/// Schema of the report.
pub const SCHEMA: &str = "mipvog-sweep/1";

/// The result of baking with one setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Size of the container in bytes.
    pub output_bytes: u64,
    /// Median wall-clock time of one bake in seconds. It excludes opening the input and the final
    /// flush to disk.
    pub seconds: f64,
    /// Number of levels of the container.
    pub levels: usize,
    /// Errors against the unbaked input, one entry per scale.
    pub errors: Vec<ScaleErrors>,
}

/// The Pareto fronts that contain this result at one scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Fronts {
    /// Factor by which the full-size picture is reduced along each side; 1 is full size.
    pub scale: usize,
    /// True if the result is on the front of container size and PSNR: no other result is at least
    /// as good in both and better in one.
    pub bytes: bool,
    /// True if the result is on the front of bake time and PSNR.
    pub seconds: bool,
}

impl Fronts {
    /// `*` for the front of size, `+` for that of time.
    pub fn marks(self) -> &'static str {
        match (self.bytes, self.seconds) {
            (true, true) => "*+",
            (true, false) => "*",
            (false, true) => "+",
            (false, false) => "",
        }
    }
}

/// One setting of the report. If its bake failed, `output_bytes`, `sha256`, `seconds` and `levels`
/// are null.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SettingReport {
    /// Name of the setting.
    pub name: String,
    /// Equivalent preset, if the sweep was asked for one.
    pub preset: Option<&'static str>,
    /// File name of the container in the sweep's folder.
    pub file: String,
    /// Options of the bake.
    pub options: serde_json::Value,
    /// Command that bakes with this setting alone; null if the sweep was not started from the
    /// command line.
    pub command: Option<String>,
    /// True if the result comes from an earlier sweep.
    pub resumed: bool,
    /// Size of the container in bytes.
    pub output_bytes: Option<u64>,
    /// SHA-256 of the container in hexadecimal.
    pub sha256: Option<String>,
    /// Median wall-clock time of one bake in seconds.
    pub seconds: Option<f64>,
    /// Number of levels of the container.
    pub levels: Option<usize>,
    /// Errors against the unbaked input, one entry per scale; empty after a failure.
    pub errors: Vec<ScaleErrors>,
    /// Pareto fronts that contain the result, one entry per scale; empty after a failure.
    pub fronts: Vec<Fronts>,
    /// Error message, if the bake failed.
    pub failure: Option<String>,
    /// Small picture for the HTML page; not in the JSON.
    #[serde(skip)]
    pub thumbnail: Option<Thumbnail>,
}

/// The report of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SweepReport {
    /// Name of the report's schema: [`SCHEMA`].
    pub schema: &'static str,
    /// File name of the input.
    pub input: String,
    /// Names of the compared frames.
    pub frames: Vec<String>,
    /// Width and height of the first frame at full size, in pixels.
    pub size: [usize; 2],
    /// Scales of the comparison; 1 is full size, 2 has half the pixels along each side.
    pub scales: Vec<usize>,
    /// Number of bakes per setting.
    pub repeat: usize,
    /// Number of threads that baked.
    pub threads: usize,
    /// The settings, in the order of the request.
    pub settings: Vec<SettingReport>,
}

impl SweepReport {
    /// The setting with the best trade-off of size and error at full size.
    pub fn recommended(&self) -> Option<&SettingReport> {
        self.settings.get(self.recommended_row()?)
    }

    /// Index of the recommended setting.
    pub(super) fn recommended_row(&self) -> Option<usize> {
        let finest = self.scales.iter().enumerate().min_by_key(|(_, scale)| **scale)?.0;
        let points = self.settings.iter().enumerate().filter_map(|(row, setting)| {
            let (errors, fronts) = (setting.errors.get(finest)?, setting.fronts.get(finest)?);
            let bytes = setting.output_bytes.filter(|_| fronts.bytes)?;
            Some((row, Point { cost: bytes as f64, quality: errors.psnr }))
        });
        let (rows, points): (Vec<_>, Vec<_>) = points.unzip();
        rows.get(knee(&points)?).copied()
    }
}

impl SettingReport {
    /// Reports a result or a failure. [`mark_fronts`] adds the fronts.
    pub(super) fn new(setting: &Setting, resumed: bool, result: Outcome) -> Self {
        let (result, thumbnail, failure) = match result {
            Ok((result, thumbnail)) => (Some(result), thumbnail, None),
            Err(failure) => (None, None, Some(failure)),
        };
        Self {
            name: setting.name.clone(),
            preset: setting.preset.map(Preset::name),
            file: format!("{}.mipvog", setting.name),
            options: setting.options.to_json(),
            command: setting.command.clone(),
            resumed,
            output_bytes: result.as_ref().map(|result| result.output_bytes),
            sha256: None,
            seconds: result.as_ref().map(|result| result.seconds),
            levels: result.as_ref().map(|result| result.levels),
            errors: result.map(|result| result.errors).unwrap_or_default(),
            fronts: Vec::new(),
            failure,
            thumbnail,
        }
    }
}

/// Marks the successful results that are on a front.
pub(super) fn mark_fronts(settings: &mut [SettingReport], scales: &[usize]) {
    for (number, &scale) in scales.iter().enumerate() {
        let points = |cost: fn(&SettingReport) -> Option<f64>| -> Vec<Point> {
            let point = |setting: &SettingReport| Point {
                cost: cost(setting).unwrap_or(f64::NAN),
                quality: setting.errors.get(number).map_or(f64::NAN, |errors| errors.psnr),
            };
            settings.iter().map(point).collect()
        };
        let by_bytes = front(&points(|setting| setting.output_bytes.map(|bytes| bytes as f64)));
        let by_seconds = front(&points(|setting| setting.seconds));
        for ((setting, bytes), seconds) in settings.iter_mut().zip(by_bytes).zip(by_seconds) {
            if setting.failure.is_none() {
                setting.fronts.push(Fronts { scale, bytes, seconds });
            }
        }
    }
}
