//! `validate`.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::common::{Common, Format};
use super::failure::message;
use super::files::for_each_file;
use super::folders::input_path;
use super::layout::{columns, folded, grouped};
use super::outcome::{Outcome, assumed, counted};
use super::scene::SceneArguments;
use super::stdin;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::finding::Severity;
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
    #[arg(required = true, value_name = "FILE", value_parser = input_path())]
    files: Vec<PathBuf>,
    /// Maximum findings to list per file (0 lists none); the rest are counted
    #[arg(long, value_name = "N", default_value_t = CheckOptions::default().max_findings)]
    max_findings: usize,
    #[command(flatten)]
    scene: SceneArguments,
}

/// Validates the files.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    // Printed findings are not repeated.
    let is_listed = common.format == Format::Text && !common.quiet;
    let several = arguments.files.len() > 1;
    let validated = RefCell::new(Vec::new());
    let mut outcome = for_each_file("validate", &arguments.files, |path| {
        let found = arguments.validate(path, is_listed, common);
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
    fn validate(
        &self,
        shown: &Path,
        is_listed: bool,
        common: &Common,
    ) -> Result<(Outcome, Report)> {
        let limits = &common.limits();
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
            let first = first.filter(|_| !is_listed).map_or_else(String::new, |first| {
                format!(", the first at {}: {}", first.place, first.message)
            });
            format!("{}: not valid: {errors}{first}", shown.display())
        });
        let denied = || {
            let warnings =
                report.findings.iter().filter(|found| found.severity == Severity::Warning);
            let count = warnings.count();
            (common.deny_warnings && count > 0).then(|| {
                let count = counted(count, "warning");
                format!("{}: {count}, and --deny-warnings is set", shown.display())
            })
        };
        let failure = failure.or_else(denied);
        let outcome = Outcome::new("validate", &report, text(shown, &report))?;
        Ok((Outcome { failure, ..outcome }, report))
    }
}

/// A line for each finding, which names the file, the code and the place; then the verdict.
fn text(path: &Path, report: &Report) -> String {
    let (mut text, name) = (String::new(), path.display());
    let mut add = |line: &str| text += &(folded(line, columns(), 4) + "\n");
    for finding in &report.findings {
        let (code, place) = (finding.code.name(), &finding.place);
        let severity = match finding.severity {
            Severity::Error => String::new(),
            other => format!("{other:?}: ").to_lowercase(),
        };
        let (message, remedy) = (assumed(&finding.message), &finding.remedy);
        add(&format!("{name}: {code}: {severity}{place}: {message}; {remedy}"));
    }
    if report.unlisted > 0 {
        let findings = counted(report.unlisted, "finding");
        add(&format!("{name}: {findings} more, which --max-findings leaves out"));
    }
    if let Some(health) = &report.health {
        let empty = 100.0 * health.empty_share;
        add(&format!("{name}: {} voxels, {empty:.1} % empty", grouped(health.nodes)));
        for channel in &health.channels {
            let Some([low, high]) = channel.range else { continue };
            add(&format!("  {}: {low} to {high}", channel.name));
        }
    }
    let verdict = if report.valid { "valid" } else { "not valid" };
    add(&format!("{name}: {verdict}"));
    text
}
