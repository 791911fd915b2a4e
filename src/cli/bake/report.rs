//! The report of `bake` and `transcode`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::super::common::Common;
use super::super::container_report::{LEGEND, levels_text};
use super::super::gate::GateReport;
use super::super::gltf::GltfReport;
use super::super::outcome::{Outcome, peak_memory_bytes, readable};
use super::super::output::STANDARD_STREAM;
use super::super::scene::{SettingReport, settings_text};
use super::super::view_report::ViewReport;
use crate::bake::BakeReport;
use crate::bake::fit::FittedLevel;
use crate::base::error::Result;

/// The results of a bake.
pub struct Baked {
    /// The container, and the work.
    pub report: BakeReport,
    /// Every option.
    pub resolved: Value,
    /// Settings of the scene and the places that they came from; none of a container.
    pub settings: Vec<SettingReport>,
    /// View-dependent colour.
    pub view: ViewReport,
    /// The figures of pictures, where there is a gate.
    pub gate: Option<GateReport>,
    /// The files that the container depends on.
    pub inputs: Vec<PathBuf>,
}

/// The files of a bake, and its cost.
pub struct Work<'a> {
    /// The file that was read.
    pub input: &'a Path,
    /// The container.
    pub output: &'a Path,
    /// Bytes of the file that was read.
    pub input_bytes: u64,
    /// Wall-clock time of all.
    pub seconds: f64,
    /// Bytes that were read of the input.
    pub bytes_read: u64,
}

/// What `bake` and `transcode` print as JSON.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct BakeJson {
    /// The file that was read.
    pub input: String,
    /// The container.
    pub output: String,
    /// True where this is a forecast: seconds, bytes of memory, of the output and of levels, and
    /// stages are estimates, and nothing was written. Left out of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dry_run: Option<bool>,
    /// Bytes of the input. Left out of a forecast.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_bytes: Option<u64>,
    /// Wall-clock time of all; null in the forecast of a fit.
    pub seconds: Option<f64>,
    /// As the operating system counts it, where it does.
    pub peak_memory_bytes: Option<u64>,
    /// Of a forecast, the least `--memory` that the bake accepts and keeps to; null where it takes
    /// no bound. Left out of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least_memory_bytes: Option<Option<u64>>,
    /// Bytes that were read of the input.
    pub bytes_read: u64,
    /// Every option, as it was resolved.
    pub options: Value,
    /// Settings of the scene, and where each came from.
    pub settings: Vec<SettingReport>,
    /// View-dependent colour.
    pub view: ViewReport,
    /// The container, and the work.
    #[serde(flatten)]
    pub report: BakeReport,
    /// Of the forecast of a fit, its maximum number of steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit_steps: Option<usize>,
    /// The figures of pictures, where there is a gate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<GateReport>,
    /// The asset of `--gltf`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gltf: Option<GltfReport>,
}

impl Baked {
    /// True if no gate is missed.
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
            input_bytes: Some(work.input_bytes),
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
        let mut text = self.text(work, common);
        text += &self.view.text();
        text += &self.gate.as_ref().map_or_else(String::new, GateReport::text);
        text += &gltf.map_or_else(String::new, GltfReport::text);
        let failure = self.gate.as_ref().and_then(|gate| gate.failure(work.output));
        let failure = failure.or_else(|| self.view.failure(work.output));
        if failure.is_none() && work.output != Path::new(STANDARD_STREAM) {
            writeln!(text, "  next: mipvog-bake view {}", work.output.display()).ok();
        }
        Ok(Outcome { failure, ..Outcome::new(verb, &json, text)? })
    }

    fn text(&self, work: &Work, common: &Common) -> String {
        let report = &self.report;
        let bytes = readable(report.output_bytes);
        let (seconds, read) = (work.seconds, readable(work.bytes_read));
        let output = work.output.display();
        let input = readable(work.input_bytes);
        let ratio = work.input_bytes as f64 / report.output_bytes.max(1) as f64;
        let missed = !self.passes();
        let mut text = match report.unchanged {
            true => format!("{output}: {bytes}, nothing has changed\n"),
            false if missed => format!("{output}: not written: it would have {bytes}\n"),
            false => format!(
                "{output}: {bytes} of {input}, 1/{ratio:.1}, in {seconds:.2} s, {read} read\n"
            ),
        };
        if !self.settings.is_empty() {
            text += &settings_text(&self.settings);
        }
        if let Some(chosen) = &report.chosen {
            writeln!(text, "  {chosen}").ok();
        }
        text += &levels_text(&report.levels, &report.shells);
        text += LEGEND;
        if let Some(finest) = report.pruned.first() {
            writeln!(
                text,
                "  of {} nodes {} are opaque, {} of them outside the free-space mask, {} retained",
                finest.nodes, finest.opaque_nodes, finest.masked_nodes, finest.needed_nodes
            )
            .ok();
        }
        if let Some(islands) = &report.islands {
            let (count, nodes) = (islands.dropped, islands.nodes);
            let all = islands.components;
            writeln!(text, "  {count} of {all} islands were dropped: {nodes} nodes").ok();
        }
        if let Some(fitted) = &report.fitted {
            for FittedLevel { level, steps, psnr_before, psnr_after, .. } in &fitted.levels {
                let (Some(psnr_before), Some(psnr_after)) = (psnr_before, psnr_after) else {
                    continue;
                };
                writeln!(
                    text,
                    "  level {level} fitted in {steps} steps, {psnr_before:.2} to {psnr_after:.2} dB"
                )
                .ok();
            }
        }
        for stage in report.stages.iter().filter(|_| common.verbose) {
            let (seconds, bytes) = (stage.seconds, readable(stage.bytes));
            writeln!(text, "  {:8} {seconds:8.3} s {bytes:>10}", stage.name).ok();
        }
        text
    }
}
