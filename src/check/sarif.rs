//! Findings as SARIF 2.1.0, which continuous integration collects from many tools.
//!
//! One run: the tool with a rule for each code of the catalogue, the files as its artifacts, a
//! result for each finding. Byte places become regions; all places are also logical locations, in
//! readable form. Source: OASIS, "Static Analysis Results Interchange Format (SARIF) Version
//! 2.1.0", sections 3.13 to 3.30.

use std::path::{Path, PathBuf};

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};

use super::report::{Report, ReportedFinding};
use crate::base::finding::{Code, Severity};

/// All characters that RFC 3986 requires to be escaped in a path.
const RESERVED: &AsciiSet =
    &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~').remove(b'/');

/// URI of the log's schema.
const SCHEMA: &str =
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json";

/// A validated file and its report, or an error if it could not be read.
pub type Validated = (PathBuf, Result<Report, String>);

/// The reports of several files, as a SARIF log of one run: services that collect logs accept one
/// per tool and category, which `automationDetails` names.
pub fn log(files: &[Validated]) -> Value {
    let (mut results, mut notifications) = (Vec::new(), Vec::new());
    for (index, (path, report)) in files.iter().enumerate() {
        let mut notify = |level: &str, text: String| {
            notifications.push(json!({
                "level": level,
                "message": { "text": text },
                "locations": [{ "physicalLocation": artifact(path, index) }],
            }));
        };
        match report {
            Ok(report) => {
                results.extend(report.findings.iter().map(|found| result(path, index, found)));
                if report.unlisted > 0 {
                    let count = report.unlisted;
                    notify("warning", format!("truncated: {count} findings are not listed"));
                }
            }
            Err(message) => notify("error", message.clone()),
        }
    }
    let artifact = |(path, _): &Validated| {
        let mut artifact = json!({ "location": { "uri": uri(path) }, "roles": ["analysisTarget"] });
        if let Ok(file) = path.metadata() {
            artifact["length"] = file.len().into();
        }
        artifact
    };
    let mut driver = json!({
        "name": env!("CARGO_PKG_NAME"),
        "semanticVersion": env!("CARGO_PKG_VERSION"),
        "rules": Code::ALL.iter().map(|&code| rule(code)).collect::<Vec<_>>(),
    });
    if let Some(homepage) = option_env!("CARGO_PKG_HOMEPAGE").filter(|page| !page.is_empty()) {
        driver["informationUri"] = homepage.into();
    }
    json!({
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [{
            "tool": { "driver": driver },
            "automationDetails": { "id": concat!(env!("CARGO_PKG_NAME"), "/validate/") },
            "invocations": [{
                "executionSuccessful": files.iter().all(|(_, report)| report.is_ok()),
                "toolExecutionNotifications": notifications,
            }],
            "artifacts": files.iter().map(artifact).collect::<Vec<_>>(),
            "results": results,
        }],
    })
}

fn rule(code: Code) -> Value {
    json!({
        "id": code.name(),
        "shortDescription": { "text": code.meaning() },
        "fullDescription": { "text": format!("{} Remedy: {}.", code.meaning(), code.remedy()) },
        "help": { "text": format!("Remedy: {}.", code.remedy()) },
        "defaultConfiguration": { "level": level(code.severity()) },
    })
}

/// The file's identity.
fn artifact(path: &Path, index: usize) -> Value {
    json!({ "artifactLocation": { "uri": uri(path), "index": index } })
}

fn result(path: &Path, index: usize, finding: &ReportedFinding) -> Value {
    let mut physical = artifact(path, index);
    // A finding about a whole file needs a location in it.
    let length = || path.metadata().map_or(0, |file| file.len());
    physical["region"] = match finding.offset {
        Some(offset) => json!({ "byteOffset": offset, "byteLength": 1 }),
        None => json!({ "byteOffset": 0, "byteLength": length() }),
    };
    json!({
        "ruleId": finding.code.name(),
        "ruleIndex": Code::ALL.iter().position(|&code| code == finding.code),
        "level": level(finding.severity),
        "message": { "text": finding.message },
        "locations": [{
            "physicalLocation": physical,
            "logicalLocations": [{ "fullyQualifiedName": finding.place }],
        }],
    })
}

fn level(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    }
}

/// The given path as a URI reference.
fn uri(path: &Path) -> String {
    let text = path.to_string_lossy();
    let text = if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() };
    utf8_percent_encode(&text, RESERVED).to_string()
}
