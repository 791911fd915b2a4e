//! `validate`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::Outcome;
use crate::check;
use crate::error::Result;
use crate::limits::Limits;

/// Report everything that is wrong with a file
#[derive(Debug, Args)]
pub struct Arguments {
    /// A container, or a glTF asset with radiance fields
    file: PathBuf,
}

/// Validates a file.
pub fn run(arguments: &Arguments) -> Result<Outcome> {
    let report = check::check(&arguments.file, &Limits::default())?;
    let mut text = String::new();
    for finding in &report.findings {
        let severity = format!("{:?}", finding.severity).to_lowercase();
        let (code, place) = (finding.code, &finding.place);
        writeln!(text, "{severity} [{code}] {place}: {}", finding.message).ok();
    }
    if report.unlisted > 0 {
        writeln!(text, "and {} more", report.unlisted).ok();
    }
    let verdict = if report.valid { "valid" } else { "not valid" };
    writeln!(text, "{}: {verdict}", arguments.file.display()).ok();
    let failed = !report.valid;
    Ok(Outcome { failed, ..Outcome::new("validate", &report, text)? })
}
