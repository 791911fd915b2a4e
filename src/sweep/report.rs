//! The report of a sweep: programs read it as JSON, [`super::csv`] and [`super::page`] show it.

use serde::{Deserialize, Serialize};

use super::pareto::{Point, front, knee};
use super::setting::Setting;
use super::thumbnail::Thumbnail;
use crate::bake::Preset;
use crate::view::compare::ScaleErrors;

/// The figures of a setting and a small picture, or the reason why there are none.
pub(super) type Outcome = std::result::Result<(Measured, Option<Thumbnail>), String>;

/// Schema of the report.
pub const SCHEMA: &str = "mipvog-sweep/1";

/// The result of a setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Bytes of the container.
    pub output_bytes: u64,
    /// Wall-clock time of one bake, the median. Opening the input is not counted, nor is waiting
    /// for the disk at the end.
    pub seconds: f64,
    /// Levels of the container.
    pub levels: usize,
    /// Distance from the unbaked input, one for each scale.
    pub errors: Vec<ScaleErrors>,
}

/// Flags of a result: for each front at one scale, true if the result is on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Fronts {
    /// Pixels of the full picture along one of this.
    pub scale: usize,
    /// No other is at most as large, at least as good, and better in one.
    pub bytes: bool,
    /// The same with time in the place of size.
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

/// One setting of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SettingReport {
    /// Its name.
    pub name: String,
    /// The preset that says the same, if one was asked for.
    pub preset: Option<&'static str>,
    /// Its container's name in the folder.
    pub file: String,
    /// Options of its bake.
    pub options: serde_json::Value,
    /// The command that bakes it alone, where the sweep came from the command line.
    pub command: Option<String>,
    /// True if the result comes from a former sweep.
    pub resumed: bool,
    /// Bytes of the container; null where it failed, as all that follows.
    pub output_bytes: Option<u64>,
    /// SHA-256 of the container, in hexadecimal digits.
    pub sha256: Option<String>,
    /// Wall-clock time of one bake, the median.
    pub seconds: Option<f64>,
    /// Levels of the container.
    pub levels: Option<usize>,
    /// Distance from the unbaked input, one for each scale; empty where it failed.
    pub errors: Vec<ScaleErrors>,
    /// One for each scale; empty where it failed.
    pub fronts: Vec<Fronts>,
    /// The failure of a setting without a result.
    pub failure: Option<String>,
    /// A small picture, for the page alone.
    #[serde(skip)]
    pub thumbnail: Option<Thumbnail>,
}

/// All of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SweepReport {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// The input's file name.
    pub input: String,
    /// Frames that were compared.
    pub frames: Vec<String>,
    /// Pixels along a row and rows of the first frame at full size.
    pub size: [usize; 2],
    /// Scales that were compared at.
    pub scales: Vec<usize>,
    /// Bakes of a setting.
    pub repeat: usize,
    /// Threads that baked.
    pub threads: usize,
    /// In the order in which they were asked for.
    pub settings: Vec<SettingReport>,
}

impl SweepReport {
    /// The setting with the best trade-off of size and error at full size.
    pub fn recommended(&self) -> Option<&SettingReport> {
        self.settings.get(self.recommended_row()?)
    }

    /// Its place among the settings.
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
    /// Of a result or a failure; its flags for the fronts are not known yet.
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

/// Marks the results on the fronts, among those that did not fail.
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
