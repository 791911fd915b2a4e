//! Validation: everything that is wrong with a file, not only the first thing.

mod asset;

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use crate::asset::is_asset;
use crate::bytes::SourceFile;
use crate::container::Container;
use crate::error::Result;
use crate::finding::{Code, Finding, Severity, checked};
use crate::limits::Limits;

/// Findings beyond this many are counted, not listed.
const MOST_FINDINGS: usize = 1000;

/// What validation says about a file.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Whether the file may be used: no finding is an error.
    pub valid: bool,
    /// In the order of the file.
    pub findings: Vec<ReportedFinding>,
    /// Findings that are not listed because there are too many.
    pub unlisted: usize,
}

/// A finding as reports print it.
#[derive(Debug, Serialize)]
pub struct ReportedFinding {
    /// Its stable code.
    pub code: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// Where in the file.
    pub place: String,
    /// What was found and what was expected.
    pub message: String,
}

/// Validates a container, or a glTF asset with the containers of its radiance fields.
///
/// # Errors
/// Only where the file cannot be opened or read at all; what is wrong with its bytes is in the
/// report.
pub fn check(path: &Path, limits: &Limits) -> Result<Report> {
    let file = Arc::new(SourceFile::open(path)?);
    let mut report = Report { valid: true, findings: Vec::new(), unlisted: 0 };
    let mut add = |finding: Finding| {
        report.add(&finding);
        Ok(())
    };
    if is_asset(&file) {
        asset::check(file, limits, &mut add)?;
        return Ok(report);
    }
    let container = Container::walk(file, limits, &mut add);
    if let Some(Some(container)) = checked(container, Code::File, &mut add)? {
        checked(container.read_reporting(&mut add), Code::File, &mut add)?;
    }
    Ok(report)
}

impl Report {
    fn add(&mut self, finding: &Finding) {
        let severity = finding.code.severity();
        self.valid &= severity != Severity::Error;
        if self.findings.len() == MOST_FINDINGS {
            self.unlisted += 1;
            return;
        }
        self.findings.push(ReportedFinding {
            code: finding.code.name(),
            severity,
            place: finding.error.place().to_string(),
            message: finding.error.kind().to_string(),
        });
    }
}
