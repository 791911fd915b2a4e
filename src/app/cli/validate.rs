//! `validate`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::field::SceneArguments;
use super::outcome::Outcome;
use crate::app::check::{self, CheckOptions, sarif};
use crate::base::error::Result;
use crate::base::limits::Limits;

/// Report everything that is wrong with a file
#[derive(Debug, Args)]
pub struct Arguments {
    /// A container, a glTF asset with radiance fields, or anything that can be baked
    file: PathBuf,
    /// Findings to list, at most; how many more there are is told
    #[arg(long, value_name = "N", default_value_t = CheckOptions::default().max_findings)]
    max_findings: usize,
    #[command(flatten)]
    scene: SceneArguments,
}

/// Validates a file.
pub fn run(arguments: &Arguments, limits: &Limits) -> Result<Outcome> {
    let options = CheckOptions {
        max_findings: arguments.max_findings,
        source: arguments.scene.source_options(),
    };
    let report = check::check_with(&arguments.file, &options, limits)?;
    let mut text = String::new();
    for finding in &report.findings {
        let severity = format!("{:?}", finding.severity).to_lowercase();
        let (code, place) = (finding.code.name(), &finding.place);
        writeln!(text, "{severity} [{code}] {place}: {}", finding.message).ok();
        writeln!(text, "  help: {}", finding.remedy).ok();
    }
    if report.unlisted > 0 {
        writeln!(text, "truncated: {} findings are not listed", report.unlisted).ok();
    }
    if let Some(health) = &report.health {
        let empty = 100.0 * health.empty_share;
        writeln!(text, "{} nodes, {empty:.1} % of them empty", health.nodes).ok();
        for channel in &health.channels {
            let Some([low, high]) = channel.range else { continue };
            writeln!(text, "{}: {low} to {high}", channel.name).ok();
        }
    }
    let verdict = if report.valid { "valid" } else { "not valid" };
    writeln!(text, "{}: {verdict}", arguments.file.display()).ok();
    let failed = !report.valid;
    let sarif = Some(sarif::log(&arguments.file, &report));
    Ok(Outcome { failed, sarif, ..Outcome::new("validate", &report, text)? })
}
