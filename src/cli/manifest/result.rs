//! The result of a scene: a line of JSON.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::common::Common;
use super::super::failure::{exit_code, message, remedy};
use super::super::outcome::Outcome;
use super::line::SceneLine;
use crate::base::error::{Error, Result};

/// The end of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It was baked.
    Baked,
    /// It was there, and nothing has changed.
    Current,
    /// It was not baked.
    Failed,
    /// Its cost was forecast.
    Forecast,
}

/// The result of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SceneResult {
    /// The input, as the manifest names it.
    pub input: String,
    /// The output, as the manifest names it.
    pub output: String,
    /// The way it ended.
    pub status: Status,
    /// The exit code that a bake of this scene alone has.
    pub exit_code: u8,
    /// Wall-clock time that it took; of a forecast the time that it will take, if that is known.
    pub seconds: Option<f64>,
    /// Bytes of the container; null where it failed.
    pub output_bytes: Option<u64>,
    /// PSNR in dB at full size, where there are cameras.
    #[serde(default)]
    pub psnr: Option<f64>,
    /// The memory that a bake will take, in a forecast.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_memory_bytes: Option<u64>,
    /// SHA-256 of the container, in hexadecimal digits; null where none was written.
    #[serde(default)]
    pub sha256: Option<String>,
    /// The warnings of the bake.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// The reason of a failure, and its remedy.
    pub error: Option<String>,
}

impl SceneResult {
    /// Of what `bake` told.
    pub fn of(scene: &SceneLine, outcome: &Result<Outcome>, seconds: f64, common: &Common) -> Self {
        let result = Self {
            input: scene.input.clone(),
            output: scene.output.clone(),
            status: Status::Failed,
            exit_code: 1,
            seconds: Some(seconds),
            output_bytes: None,
            psnr: None,
            peak_memory_bytes: None,
            sha256: None,
            warnings: common.warnings.texts(),
            error: None,
        };
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(error) => {
                let words = format!("{}; {}", message(error), remedy(error));
                let exit_code = exit_code(error.kind());
                return Self { exit_code, error: Some(words), ..result };
            }
        };
        let report = &outcome.json;
        let psnr = report["quality"]["errors"][0]["psnr"].as_f64();
        if let Some(reason) = &outcome.failure {
            return Self { psnr, error: Some(reason.clone()), ..result };
        }
        let output_bytes = report["output_bytes"].as_u64();
        let sha256 = report["sha256"].as_str().map(str::to_owned);
        let done = Self { exit_code: 0, output_bytes, psnr, sha256, ..result };
        match (&report["dry_run"], &report["unchanged"]) {
            (Value::Bool(true), _) => Self {
                status: Status::Forecast,
                seconds: report["seconds"].as_f64(),
                peak_memory_bytes: report["peak_memory_bytes"].as_u64(),
                ..done
            },
            (_, Value::Bool(true)) => Self { status: Status::Current, ..done },
            _ => Self { status: Status::Baked, ..done },
        }
    }

    /// True if the scene was not baked.
    pub fn is_failed(&self) -> bool {
        self.status == Status::Failed
    }

    /// The result as a line of JSON.
    ///
    /// # Errors
    /// `Usage` for what JSON cannot hold.
    pub fn line(&self) -> Result<String> {
        let line = serde_json::to_string(self).map(|line| line + "\n");
        line.map_err(|error| Error::usage(format!("the result is not JSON: {error}")))
    }
}
