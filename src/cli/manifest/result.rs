//! The result of a scene: a line of JSON.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::common::Common;
use super::super::failure::{exit_code, message, remedy};
use super::super::outcome::Outcome;
use super::line::SceneLine;
use crate::base::error::{Error, Result};

/// The status of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The scene was baked.
    Baked,
    /// The container is up to date; nothing was baked.
    Current,
    /// The scene could not be baked.
    Failed,
    /// The cost of the bake was forecast.
    Forecast,
}

/// The result of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SceneResult {
    /// Path of the input, as in the manifest.
    pub input: String,
    /// Path of the output, as in the manifest.
    pub output: String,
    /// Status of the scene.
    pub status: Status,
    /// Exit code of a bake of this scene alone.
    pub exit_code: u8,
    /// Wall-clock time in seconds. In a forecast, the expected time, or null if unknown.
    pub seconds: Option<f64>,
    /// Size of the container in bytes; null after a failure.
    pub output_bytes: Option<u64>,
    /// PSNR at full size in dB; null without cameras.
    #[serde(default)]
    pub psnr: Option<f64>,
    /// Expected peak memory in bytes; only in a forecast.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_memory_bytes: Option<u64>,
    /// SHA-256 of the container in hexadecimal; null if none was written.
    #[serde(default)]
    pub sha256: Option<String>,
    /// Version of the program.
    #[serde(default)]
    pub version: String,
    /// Warnings of the bake.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Reason for the failure, and its remedy; null after a success.
    pub error: Option<String>,
}

impl SceneResult {
    /// Makes the result from the outcome of `bake`.
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
            version: env!("CARGO_PKG_VERSION").to_owned(),
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

    /// True if the bake failed.
    pub fn is_failed(&self) -> bool {
        self.status == Status::Failed
    }

    /// The result as a line of JSON.
    ///
    /// # Errors
    /// `Usage` if JSON cannot represent the result.
    pub fn line(&self) -> Result<String> {
        let line = serde_json::to_string(self).map(|line| line + "\n");
        line.map_err(|error| Error::usage(format!("the result is not JSON: {error}")))
    }
}
