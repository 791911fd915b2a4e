//! Findings as SARIF 2.1.0, the form in which continuous integration gathers those of many tools.
//!
//! One run: the tool with a rule for each code of the catalogue, the file as its artifact, a result
//! for each finding. Places that are a byte become regions; all are logical locations too, as
//! people read them. Source: OASIS, "Static Analysis Results Interchange Format (SARIF) Version
//! 2.1.0", sections 3.13 to 3.30.

use std::path::Path;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};

use super::report::{Report, ReportedFinding};
use crate::base::finding::{Code, Severity};

/// All that RFC 3986 does not leave as it is in a path.
const RESERVED: &AsciiSet =
    &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~').remove(b'/');

/// The schema that the log says it follows.
const SCHEMA: &str =
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json";

/// The report of validating `path`, as a SARIF log.
pub fn log(path: &Path, report: &Report) -> Value {
    let results: Vec<Value> = report.findings.iter().map(|f| result(path, f)).collect();
    let mut notifications = Vec::new();
    if report.unlisted > 0 {
        let text = format!("truncated: {} findings are not listed", report.unlisted);
        notifications.push(json!({ "level": "warning", "message": { "text": text } }));
    }
    let rules: Vec<Value> = Code::ALL.iter().map(|&code| rule(code)).collect();
    json!({
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [{
            "tool": { "driver": {
                "name": env!("CARGO_PKG_NAME"),
                "semanticVersion": env!("CARGO_PKG_VERSION"),
                "rules": rules,
            } },
            "invocations": [{
                "executionSuccessful": true,
                "toolExecutionNotifications": notifications,
            }],
            "artifacts": [{ "location": { "uri": uri(path) }, "roles": ["analysisTarget"] }],
            "results": results,
        }],
    })
}

/// One log of the runs of several.
pub fn merge(logs: Vec<Value>) -> Option<Value> {
    let mut logs = logs.into_iter();
    let mut merged = logs.next()?;
    for mut log in logs {
        if let (Some(all), Some(runs)) = (merged["runs"].as_array_mut(), log["runs"].as_array_mut())
        {
            all.append(runs);
        }
    }
    Some(merged)
}

fn rule(code: Code) -> Value {
    json!({
        "id": code.name(),
        "shortDescription": { "text": code.meaning() },
        "help": { "text": format!("Remedy: {}.", code.remedy()) },
        "defaultConfiguration": { "level": level(code.severity()) },
    })
}

fn result(path: &Path, finding: &ReportedFinding) -> Value {
    let mut physical = json!({ "artifactLocation": { "uri": uri(path), "index": 0 } });
    if let Some(offset) = finding.offset {
        physical["region"] = json!({ "byteOffset": offset, "byteLength": 1 });
    }
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

/// The path as it was given, as a URI reference.
fn uri(path: &Path) -> String {
    let text = path.to_string_lossy();
    let text = if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() };
    utf8_percent_encode(&text, RESERVED).to_string()
}
