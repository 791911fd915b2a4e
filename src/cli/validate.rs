//! `validate`.

use std::cell::RefCell;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::failure::message;
use super::files::for_each_file;
use super::outcome::{Outcome, counted};
use super::scene::SceneArguments;
use super::stdin;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::finding::Severity;
use crate::base::limits::Limits;
use crate::check::{self, CheckOptions, Report, sarif};
use mipvog_inputs::tensor::is_tensors;

/// List every problem in files
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake validate scene.mipvog
  mipvog-bake validate *.mipvog --quiet
  mipvog-bake validate scene.glb --format sarif > findings.sarif

The exit code is 1 if a finding is an error, with --quiet too.")]
pub struct Arguments {
    /// Containers, glTF assets with radiance fields, or anything that can be baked; - means
    /// standard input
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Maximum findings to list per file (0: none); the rest are counted
    #[arg(long, value_name = "N", default_value_t = CheckOptions::default().max_findings)]
    max_findings: usize,
    #[command(flatten)]
    scene: SceneArguments,
}

/// Validates the files.
pub fn run(arguments: &Arguments, limits: &Limits) -> Result<Outcome> {
    let several = arguments.files.len() > 1;
    let validated = RefCell::new(Vec::new());
    let mut outcome = for_each_file("validate", &arguments.files, |path| {
        let found = arguments.validate(path, limits);
        let (outcome, report) = match found {
            Ok((outcome, report)) => (Ok(outcome), Ok(report)),
            Err(error) => {
                let said = message(&error);
                (Err(error), Err(said))
            }
        };
        validated.borrow_mut().push((path.to_owned(), report));
        outcome
    })?;
    outcome.sarif = Some(sarif::log(&validated.into_inner()));
    if several && let Value::Object(report) = &mut outcome.json {
        report.insert("valid".to_owned(), outcome.failure.is_none().into());
    }
    Ok(outcome)
}

impl Arguments {
    fn validate(&self, shown: &Path, limits: &Limits) -> Result<(Outcome, Report)> {
        let path = stdin::resolve(shown)?;
        let source = match is_tensors(&SourceFile::open(&path)?)? {
            true => self.scene.settings(&path, None, limits)?.options,
            false => self.scene.source_options(),
        };
        let options = CheckOptions { max_findings: self.max_findings, source };
        let report = check::check_with(&path, &options, limits)?;
        let errors = counted(report.errors, "error");
        let failure = (!report.valid).then(|| {
            let first = report.findings.iter().find(|found| found.severity == Severity::Error);
            let first = first.map_or_else(String::new, |first| {
                format!(", the first at {}: {}", first.place, first.message)
            });
            format!("{}: not valid: {errors}{first}", shown.display())
        });
        let outcome = Outcome::new("validate", &report, text(shown, &report))?;
        Ok((Outcome { failure, ..outcome }, report))
    }
}

fn text(path: &Path, report: &Report) -> String {
    let mut text = String::new();
    for finding in &report.findings {
        let severity = format!("{:?}", finding.severity).to_lowercase();
        let (code, place) = (finding.code.name(), &finding.place);
        writeln!(text, "{severity} [{code}] {place}: {}", finding.message).ok();
        writeln!(text, "  help: {}", finding.remedy).ok();
    }
    if report.unlisted > 0 {
        let findings = counted(report.unlisted, "finding");
        writeln!(text, "truncated: {findings} not listed").ok();
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
    writeln!(text, "{}: {verdict}", path.display()).ok();
    text
}
