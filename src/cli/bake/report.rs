//! The report of `bake` and `transcode`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::super::common::Common;
use super::super::container_report::{legend, levels_text};
use super::super::gate::GateReport;
use super::super::gltf::GltfReport;
use super::super::layout::{Table, columns, folded, grouped};
use super::super::outcome::{Outcome, denied, peak_memory_bytes, readable};
use super::super::output::STANDARD_STREAM;
use super::super::scene::{SettingReport, settings_text};
use super::super::shell;
use super::super::view_report::ViewReport;
use crate::bake::fit::FittedLevel;
use crate::bake::{BakeReport, LevelReport};
use crate::base::error::Result;

/// The results of a bake.
pub struct Baked {
    /// The container and the work.
    pub report: BakeReport,
    /// All options, as resolved.
    pub resolved: Value,
    /// Settings of the scene, and the source of each; empty for a container.
    pub settings: Vec<SettingReport>,
    /// View-dependent colour.
    pub view: ViewReport,
    /// Errors from the cameras of the quality gate, if there are any.
    pub gate: Option<GateReport>,
    /// Bytes of memory that measuring the loss would have taken, if that exceeds the limit.
    pub unmeasured: Option<u64>,
    /// The files that the container depends on.
    pub inputs: Vec<PathBuf>,
    /// Size of the input in bytes.
    pub input_bytes: u64,
}

/// The files of a bake and its cost.
pub struct Work<'a> {
    /// Path of the input.
    pub input: &'a Path,
    /// Path of the container.
    pub output: &'a Path,
    /// Total wall-clock time in seconds.
    pub seconds: f64,
    /// Bytes read from the input.
    pub bytes_read: u64,
    /// SHA-256 of the container, if written.
    pub sha256: Option<String>,
}

/// The JSON report of `bake` and `transcode`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct BakeJson {
    /// Path of the input.
    pub input: String,
    /// Path of the container.
    pub output: String,
    /// True in a forecast: nothing was written, and times, sizes, memory and stages are estimates.
    /// Absent from the report of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dry_run: Option<bool>,
    /// Size of the input in bytes. Absent from a forecast.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_bytes: Option<u64>,
    /// SHA-256 of the container in hexadecimal; null if none was written.
    pub sha256: Option<String>,
    /// Total wall-clock time in seconds; null in the forecast of a fit.
    pub seconds: Option<f64>,
    /// Peak memory of the process in bytes, as the operating system measures it; null if it does
    /// not.
    pub peak_memory_bytes: Option<u64>,
    /// Forecast only: the smallest `--memory` that the bake accepts, in bytes; null if the bake
    /// cannot bound its memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_memory_bytes: Option<Option<u64>>,
    /// Bytes read from the input. Data that is read twice counts twice.
    pub bytes_read: u64,
    /// All options, as resolved.
    pub options: Value,
    /// Settings of the scene, and the source of each.
    pub settings: Vec<SettingReport>,
    /// View-dependent colour of the container.
    pub view: ViewReport,
    /// The container and the work.
    #[serde(flatten)]
    pub report: BakeReport,
    /// Forecast of a fit only: the maximum number of steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit_steps: Option<usize>,
    /// Errors from the cameras of the quality gate, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<GateReport>,
    /// The asset of `--gltf`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gltf: Option<GltfReport>,
}

impl Baked {
    /// True if all gates pass.
    pub fn passes(&self) -> bool {
        self.gate.as_ref().is_none_or(|gate| gate.passed) && self.view.passes()
    }

    /// The report, for people and for programs.
    pub fn outcome(
        &self,
        verb: &str,
        work: &Work,
        gltf: Option<&GltfReport>,
        common: &Common,
    ) -> Result<Outcome> {
        let json = BakeJson {
            input: work.input.to_string_lossy().into_owned(),
            output: work.output.to_string_lossy().into_owned(),
            dry_run: None,
            input_bytes: Some(self.input_bytes),
            sha256: work.sha256.clone(),
            seconds: Some(work.seconds),
            peak_memory_bytes: peak_memory_bytes(),
            least_memory_bytes: None,
            bytes_read: work.bytes_read,
            options: self.resolved.clone(),
            settings: self.settings.clone(),
            view: self.view,
            report: self.report.clone(),
            fit_steps: None,
            quality: self.gate.clone(),
            gltf: gltf.cloned(),
        };
        let failure = self.gate.as_ref().and_then(|gate| gate.failure(work.output));
        let failure = failure.or_else(|| self.view.failure(work.output));
        let failure = failure.or_else(|| {
            let denied = denied(common)?;
            Some(format!("{}: not written: {denied}", work.output.display()))
        });
        let mut lines = self.lines(work, failure.is_some());
        lines.extend(self.view.lines());
        let mut text = folded_lines(&lines);
        if common.verbose {
            text += &self.details(work);
        }
        if let Some(gate) = &self.gate {
            text += &gate.text(work.input);
            if self.is_seen_from_cameras() {
                let line =
                    "  from the cameras that decided what is kept: others may see more errors";
                text += &(folded(line, columns(), 4) + "\n");
            }
        }
        text += &gltf.map_or_else(String::new, GltfReport::text);
        if failure.is_none() && work.output != Path::new(STANDARD_STREAM) {
            // As it stands: a command that is folded cannot be pasted.
            let next = shell::command(["view".as_ref(), work.output.as_os_str()]);
            writeln!(text, "  next: {next}").ok();
        }
        Ok(Outcome { failure, ..Outcome::new(verb, &json, text)? })
    }

    /// True if what cameras see decided which voxels are kept or coarse.
    fn is_seen_from_cameras(&self) -> bool {
        let is_set = |name: &str| self.resolved[name].as_f64().is_some_and(|value| value > 0.0);
        ["min_weight", "coarseness", "fill_error"].into_iter().any(is_set)
    }

    /// The sizes, the contents of the container, and the sources of the settings.
    fn lines(&self, work: &Work, is_refused: bool) -> Vec<String> {
        let report = &self.report;
        let (output, bytes) = (work.output.display(), readable(report.output_bytes));
        let mut lines = vec![match (report.unchanged, is_refused) {
            (_, true) => format!("{output}: not written; it would have {bytes}"),
            (true, false) => format!("{output}: {bytes}, nothing has changed"),
            (false, false) => {
                let sizes = compared(report.output_bytes, self.input_bytes);
                let measured = if self.gate.is_some() { ", pictures included" } else { "" };
                format!(
                    "{output}: {bytes}, {sizes} {} ({}), in {:.2} s{measured}",
                    short_name(work.input),
                    readable(self.input_bytes),
                    work.seconds
                )
            }
        }];
        let first = first_picture(&report.levels, report.output_bytes);
        let first = first.map(|bytes| format!("first, coarse picture after {}", readable(bytes)));
        let kept = report.pruned.first().map(|finest| {
            let share = 100.0 * finest.needed_nodes as f64 / finest.nodes.max(1) as f64;
            let [kept, all] = [finest.needed_nodes, finest.nodes].map(grouped);
            let of = if report.shells.is_empty() { "" } else { " of the innermost box" };
            format!("{kept} of {all} voxels{of} kept ({share:.0} %)")
        });
        let content: Vec<String> = first.into_iter().chain(kept).collect();
        if !content.is_empty() {
            lines.push(format!("  {}", content.join("; ")));
        }
        if let Some(islands) = &report.islands {
            let (dropped, all) = (islands.dropped, islands.components);
            let voxels = grouped(islands.nodes);
            lines.push(format!("  {dropped} of {all} islands dropped: {voxels} voxels"));
        }
        if !self.settings.is_empty() {
            lines.push(settings_text(&self.settings));
        }
        lines.extend(report.chosen.iter().map(|chosen| format!("  {chosen}")));
        lines.extend(self.unmeasured.map(|bytes| {
            format!(
                "  loss not measured: it takes {} of memory, and mipvog-bake compare measures it",
                readable(bytes)
            )
        }));
        let fitted = report.fitted.iter().flat_map(|fitted| &fitted.levels);
        lines.extend(fitted.filter_map(
            |FittedLevel { level, steps, psnr_before, psnr_after, .. }| {
                let (before, after) = (psnr_before.as_ref()?, psnr_after.as_ref()?);
                Some(format!(
                    "  level {level} fitted in {steps} steps: {before:.2} to {after:.2} dB"
                ))
            },
        ));
        lines
    }

    /// The table of levels, and the cost of each stage.
    fn details(&self, work: &Work) -> String {
        let report = &self.report;
        let mut text = levels_text(&report.levels, &report.shells, true);
        text += &legend(!report.shells.is_empty());
        let mut lines = Vec::new();
        if let Some(finest) = report.pruned.first() {
            let opaque = grouped(finest.opaque_nodes);
            let masked = match finest.masked_nodes {
                0 => String::new(),
                masked => format!(", {} of them outside the free-space mask", grouped(masked)),
            };
            lines.push(format!("  {opaque} voxels above --alpha-threshold{masked}"));
        }
        lines.push(format!("  {} read of the input", readable(work.bytes_read)));
        text += &folded_lines(&lines);
        let mut table = Table::new(["stage", "seconds", "bytes"], 1);
        for stage in &report.stages {
            let (seconds, bytes) = (format!("{:.3}", stage.seconds), readable(stage.bytes));
            table.add([stage.name.to_owned(), seconds, bytes]);
        }
        text + &table.text(columns())
    }
}

fn folded_lines(lines: &[String]) -> String {
    lines.iter().map(|line| folded(line, columns(), 4) + "\n").collect()
}

/// The viewer's first picture comes from at most one in this many bytes of the file.
const FIRST_PICTURE: u64 = 25;

/// Bytes that the viewer reads before its first picture: the prefix of the finest level within 4 %
/// of the file, else of the coarsest level. `None` if that is the whole file.
fn first_picture(levels: &[LevelReport], bytes: u64) -> Option<u64> {
    let mut prefixes = levels.iter().filter_map(|level| level.prefix_bytes);
    let coarsest = levels.last().and_then(|level| level.prefix_bytes);
    let first = prefixes.find(|prefix| prefix * FIRST_PICTURE <= bytes).or(coarsest);
    first.filter(|first| *first < bytes)
}

/// The name of an input without its folders.
pub fn short_name(input: &Path) -> String {
    match input == Path::new(STANDARD_STREAM) {
        true => "the input".to_owned(),
        false => input.file_name().unwrap_or(input.as_os_str()).to_string_lossy().into_owned(),
    }
}

/// The size of an output relative to its input, in words.
fn compared(output: u64, input: u64) -> String {
    let (output, input) = (output.max(1) as f64, input.max(1) as f64);
    // Within the two digits below.
    if (output / input - 1.0).abs() < 0.005 {
        return "as large as".to_owned();
    }
    let (factor, word) = match output <= input {
        true => (input / output, "smaller"),
        false => (output / input, "larger"),
    };
    // Two digits: more say nothing.
    match factor < 9.95 {
        true => format!("{factor:.1} x {word} than"),
        false => format!("{factor:.0} x {word} than"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_compared_in_two_digits() {
        assert_eq!(compared(3_620_000, 86_000_000), "24 x smaller than");
        assert_eq!(compared(10, 99), "9.9 x smaller than");
        assert_eq!(compared(7, 7), "as large as");
        assert_eq!(compared(7000, 7010), "as large as");
        assert_eq!(compared(30, 20), "1.5 x larger than");
        assert_eq!(compared(0, 0), "as large as");
    }
}
