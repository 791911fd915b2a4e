//! Verbs that take several files.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::failure::{message, remedy};
use super::layout::{columns, folded};
use super::outcome::Outcome;
use crate::base::error::Result;

/// Failures in the last line, which the report above it lists.
const NAMED: usize = 3;

/// Runs a verb on each file. One file has its own report. Several files share a report with a list
/// `files`; a failed file is listed there and does not stop the others.
///
/// # Errors
///
/// Those of a single file.
pub fn for_each_file(
    verb: &str,
    files: &[PathBuf],
    run: impl Fn(&Path) -> Result<Outcome>,
) -> Result<Outcome> {
    if let [file] = files {
        return run(file);
    }
    let (mut text, mut reports, mut failures) = (String::new(), Vec::new(), Vec::new());
    for file in files {
        let name = file.display().to_string();
        let mut report = match run(file) {
            Ok(outcome) => {
                text += &outcome.text;
                failures.extend(outcome.failure);
                outcome.json
            }
            Err(error) => {
                let said = message(&error);
                text += &(folded(&format!("{said}; {}", remedy(&error)), columns(), 4) + "\n");
                failures.push(said.clone());
                json!({ "error": said })
            }
        };
        if let Value::Object(report) = &mut report {
            report.remove("schema");
            report.insert("file".to_owned(), name.into());
        }
        reports.push(report);
    }
    let (count, failed) = (files.len(), failures.len());
    text += &format!("{count} files, {failed} failed\n");
    let outcome = Outcome::new(verb, &json!({ "files": reports, "failed": failed }), text)?;
    let reason = || {
        let more = match failures.len().checked_sub(NAMED) {
            None | Some(0) => String::new(),
            Some(more) => format!(" and {more} more"),
        };
        let named: Vec<&str> = failures.iter().take(NAMED).map(String::as_str).collect();
        format!("{failed} of {count} files failed: {}{more}", named.join("; "))
    };
    Ok(Outcome { failure: (failed > 0).then(reason), ..outcome })
}
