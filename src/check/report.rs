//! The findings of a file, for programs and people.

use serde::Serialize;

use super::health::Health;
use crate::base::error::Place;
use crate::base::finding::{Code, Finding, Severity};

/// Characters of one message, at most: a found value may be as long as a file.
const MESSAGE_CHARACTERS: usize = 500;

/// The result of a validation.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Report {
    /// True if no finding is an error: the file may be used.
    pub valid: bool,
    /// In the order of the file.
    pub findings: Vec<ReportedFinding>,
    /// Findings that are not listed because there are too many; above 0 the list is truncated.
    pub unlisted: usize,
    /// Findings that are errors, listed or not.
    #[serde(skip)]
    pub errors: usize,
    /// Measurements of an input of a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub health: Option<Health>,
    #[serde(skip)]
    max_findings: usize,
}

/// A finding as reports print it.
#[derive(Debug, Serialize, Clone)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ReportedFinding {
    /// Its stable code.
    #[serde(serialize_with = "name")]
    #[cfg_attr(feature = "schemas", schemars(with = "String"))]
    pub code: Code,
    /// The finding's severity.
    pub severity: Severity,
    /// The place in the file.
    pub place: String,
    /// The place as a byte of the file, where it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<u64>,
    /// The value found and the value expected.
    pub message: String,
    /// The advice to the file's owner.
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
