//! Validation: everything that is wrong with a file, not only the first thing.
//!
//! [`check`] tells by content what a file is. Containers and assets are walked by the rules that strict
//! readers use; inputs of a bake are opened as a bake opens them and then read once, plane by plane
//! ([`health`]). What is kept of it all is a bounded list of findings; [`sarif`] is the same list for
//! programs that gather findings of many tools.

mod asset;
pub mod health;
mod input;
pub mod sarif;

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Finding, Severity, checked};
use crate::base::limits::Limits;
use crate::codec::container::{Container, starts_container};
use crate::input::checkpoint::SourceOptions;
use crate::input::tensor;
use crate::output::gltf::asset::is_asset;
use health::Health;

/// Characters of one message, at most: what was found may be as long as a file.
const MESSAGE_CHARACTERS: usize = 500;

/// How a file is validated.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CheckOptions {
    /// Findings beyond this many are counted, not listed. Default: 1000
    pub most_findings: usize,
    /// What the user says about an input. Default: nothing
    pub source: SourceOptions,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { most_findings: 1000, source: SourceOptions::default() }
    }
}

/// What validation says about a file.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Whether the file may be used: no finding is an error.
    pub valid: bool,
    /// In the order of the file.
    pub findings: Vec<ReportedFinding>,
    /// Findings that are not listed because there are too many; above 0 the list is truncated.
    pub unlisted: usize,
    /// What was measured of an input of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub health: Option<Health>,
    #[serde(skip)]
    most_findings: usize,
}

/// A finding as reports print it.
#[derive(Debug, Serialize)]
pub struct ReportedFinding {
    /// Its stable code.
    #[serde(serialize_with = "name")]
    pub code: Code,
    /// How bad it is.
    pub severity: Severity,
    /// Where in the file.
    pub place: String,
    /// The place as a byte of the file, where it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<u64>,
    /// What was found and what was expected.
    pub message: String,
    /// What can be done about it.
    pub remedy: &'static str,
}

/// Validates a container, a glTF asset with the containers of its radiance fields, or an input of a bake.
///
/// # Errors
/// Only where the file cannot be opened or read at all; what is wrong with its bytes is in the
/// report.
pub fn check(path: &Path, limits: &Limits) -> Result<Report> {
    check_with(path, &CheckOptions::default(), limits)
}

/// The same with options.
///
/// # Errors
/// Those of [`check`], and `Usage` for options out of range.
pub fn check_with(path: &Path, options: &CheckOptions, limits: &Limits) -> Result<Report> {
    check_file(Arc::new(SourceFile::open(path)?), options, limits)
}

/// The same for a file that is open already.
///
/// # Errors
/// Those of [`check_with`].
pub fn check_file(
    file: Arc<SourceFile>,
    options: &CheckOptions,
    limits: &Limits,
) -> Result<Report> {
    options.source.check()?;
    let mut report = Report::new(options.most_findings);
    let mut add = |finding: Finding| {
        report.add(&finding);
        Ok(())
    };
    if is_asset(&file) {
        asset::check(file, limits, &mut add)?;
    } else if starts_container(&file) {
        let container = Container::walk(file, limits, &mut add);
        if let Some(Some(container)) = checked(container, Code::File, &mut add)? {
            checked(container.check_contents(&mut add), Code::File, &mut add)?;
        }
    } else if tensor::is_tensors(&file)? {
        report.health = input::check(file, &options.source, limits, &mut add)?;
    } else {
        let found = tensor::describe(&file)?;
        let expected = "a container, a glTF asset, or a file of tensors";
        add(Finding { code: Code::File, error: Error::malformed(Place::File, found, expected) })?;
    }
    Ok(report)
}

impl Report {
    fn new(most_findings: usize) -> Self {
        Self { valid: true, findings: Vec::new(), unlisted: 0, health: None, most_findings }
    }

    fn add(&mut self, finding: &Finding) {
        let severity = finding.code.severity();
        self.valid &= severity != Severity::Error;
        if self.findings.len() >= self.most_findings {
            self.unlisted += 1;
            return;
        }
        let place = finding.error.place();
        self.findings.push(ReportedFinding {
            code: finding.code,
            severity,
            place: clipped(place.to_string()),
            offset: match place {
                Place::Offset(offset) => Some(*offset),
                _ => None,
            },
            message: clipped(finding.error.kind().to_string()),
            remedy: finding.code.remedy(),
        });
    }
}

/// A text of at most [`MESSAGE_CHARACTERS`].
fn clipped(mut text: String) -> String {
    if let Some((end, _)) = text.char_indices().nth(MESSAGE_CHARACTERS) {
        text.truncate(end);
        text.push_str(" ...");
        text.shrink_to_fit();
    }
    text
}

fn name<S: serde::Serializer>(code: &Code, to: S) -> std::result::Result<S::Ok, S::Error> {
    to.serialize_str(code.name())
}
