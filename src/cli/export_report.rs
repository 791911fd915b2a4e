//! The report of an export, for programs and for people.

use serde::Serialize;
use serde_json::{Map, Value};

use super::layout::{columns, folded};
use super::outcome::{counted, readable};
use mipvog_outputs::export_files::FileReport;

#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ExportReport {
    pub(super) input: String,
    pub(super) output: String,
    pub(super) format: &'static str,
    pub(super) level: usize,
    pub(super) seconds: f64,
    pub(super) output_bytes: u64,
    /// Empty if the gate was missed.
    pub(super) files: Vec<FileReport>,
    /// The mean over the cameras, in dB.
    pub(super) psnr: Option<f64>,
    /// Over the pixels of all cameras, in dB; the gate's figure.
    pub(super) pooled_psnr: Option<f64>,
    pub(super) cameras: usize,
    /// Pixels along x and y of the first camera's picture.
    pub(super) picture_size: [usize; 2],
    pub(super) required_psnr: Option<f64>,
    pub(super) passed: bool,
    pub(super) lost: Vec<String>,
    pub(super) details: Map<String, Value>,
}

impl ExportReport {
    /// For people.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        let mut add = |line: &str| text += &(folded(line, columns(), 4) + "\n");
        for file in &self.files {
            add(&format!("{}: {}", file.path, readable(file.bytes)));
        }
        let pictures = counted(self.cameras, "picture");
        if let Some(psnr) = self.pooled_psnr {
            let [width, height] = self.picture_size;
            add(&format!("  {psnr:.2} dB against the field, {pictures} of {width}x{height}"));
        }
        for lost in &self.lost {
            add(&format!("  lost: {lost}"));
        }
        text
    }
}
