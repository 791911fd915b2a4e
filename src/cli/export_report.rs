//! The report of an export, as JSON and as text.

use serde::Serialize;
use serde_json::{Map, Value};

use super::layout::{columns, folded, grouped};
use super::outcome::{counted, readable};
use mipvog_outputs::export_files::FileReport;

/// The report of `export`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ExportReport {
    /// Path of the exported field.
    pub(super) input: String,
    /// Path of the export.
    pub(super) output: String,
    /// Format of the export, as in `--to`.
    pub(super) format: &'static str,
    /// Exported level; 0 is the finest.
    pub(super) level: usize,
    /// Total wall-clock time in seconds.
    pub(super) seconds: f64,
    /// Total size of the written files in bytes.
    pub(super) output_bytes: u64,
    /// Written files; empty if the quality gate failed.
    pub(super) files: Vec<FileReport>,
    /// Mean PSNR over the cameras in dB, at most 200; null if not measured.
    pub(super) psnr: Option<f64>,
    /// PSNR of the mean squared error over the pixels of all cameras in dB, at most 200; null if
    /// not measured. The quality gate uses it.
    pub(super) pooled_psnr: Option<f64>,
    /// Number of cameras.
    pub(super) cameras: usize,
    /// Width and height of the first camera's picture, in pixels.
    pub(super) picture_size: [usize; 2],
    /// Required pooled PSNR in dB; null if none is required.
    pub(super) required_psnr: Option<f64>,
    /// True if the required PSNR is reached or none is required.
    pub(super) passed: bool,
    /// Contents of the source that the format cannot represent.
    pub(super) lost: Vec<String>,
    /// Figures that only this format has.
    pub(super) details: Map<String, Value>,
}

/// Most files that are listed.
const LISTED: usize = 8;
/// PSNR of equal pictures.
const IDENTICAL: f64 = 200.0;

impl ExportReport {
    /// The text of the report.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        let mut add = |line: &str| text += &(folded(line, columns(), 4) + "\n");
        let count = |name: &str| self.details.get(name).and_then(Value::as_u64);
        let counts = ["triangles", "splats", "voxels"]
            .into_iter()
            .filter_map(|name| Some(format!(", {} {name}", grouped(count(name)?))));
        let counts: String = counts.collect();
        match self.files.as_slice() {
            files if files.len() > LISTED => {
                let count = counted(files.len(), "file");
                add(&format!("{}: {count}, {}", self.output, readable(self.output_bytes)));
            }
            files => {
                for (number, file) in files.iter().enumerate() {
                    let counts = if number == 0 { counts.as_str() } else { "" };
                    add(&format!("{}: {}{counts}", file.path, readable(file.bytes)));
                }
            }
        }
        let pictures = counted(self.cameras, "picture");
        if let Some(psnr) = self.pooled_psnr {
            let [width, height] = self.picture_size;
            let field = match self.level {
                0 => "the field".to_owned(),
                level => format!("level {level} of the field"),
            };
            let said = match psnr < IDENTICAL {
                true => format!("{psnr:.2} dB against {field}"),
                false => format!("identical to {field}"),
            };
            add(&format!("  {said}, {pictures} of {width}x{height}"));
        }
        for lost in &self.lost {
            add(&format!("  lost: {lost}"));
        }
        text
    }
}
