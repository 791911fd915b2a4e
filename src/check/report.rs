//! The findings of a file, as JSON and as text.

use serde::Serialize;

use super::health::Health;
use crate::base::error::Place;
use crate::base::finding::{Code, Finding, Severity};

/// Maximum length of a message in characters. A found value can be as long as the file.
const MESSAGE_CHARACTERS: usize = 500;

/// The result of a validation.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Report {
    /// True if the file can be used: no finding is an error.
    pub valid: bool,
    /// Findings, in the order of the file.
    pub findings: Vec<ReportedFinding>,
    /// Number of findings beyond the limit, which `findings` leaves out.
    pub unlisted: usize,
    /// Number of findings that are errors, listed or not.
    #[serde(skip)]
    pub errors: usize,
    /// Statistics of the values; only for an input of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub health: Option<Health>,
    #[serde(skip)]
    max_findings: usize,
}

/// A finding in a report.
#[derive(Debug, Serialize, Clone)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ReportedFinding {
    /// Stable code of the finding.
    #[serde(serialize_with = "name")]
    #[cfg_attr(feature = "schemas", schemars(with = "String"))]
    pub code: Code,
    /// Severity of the finding.
    pub severity: Severity,
    /// Place in the file.
    pub place: String,
    /// Byte offset of the place in the file; absent for places that are not bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<u64>,
    /// Found and expected values.
    pub message: String,
    /// How to fix the file.
    pub remedy: String,
}

impl Report {
    pub(super) fn new(max_findings: usize) -> Self {
        let findings = Vec::new();
        Self { valid: true, findings, unlisted: 0, errors: 0, health: None, max_findings }
    }

    pub(super) fn add(&mut self, finding: &Finding) {
        let severity = finding.code.severity();
        let is_error = severity == Severity::Error;
        self.valid &= !is_error;
        self.errors += usize::from(is_error);
        if self.findings.len() >= self.max_findings {
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
            remedy: finding.remedy().to_owned(),
        });
    }
}

/// Truncates a text to [`MESSAGE_CHARACTERS`].
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
