//! An error as `--format json` prints it.

use serde::Serialize;

use super::call::Failure;
use super::outcome::{Outcome, say, write_stdout};

/// The report of a failed verb.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ErrorReport<'a> {
    /// Details of the error.
    error: ErrorDetails<'a>,
}

/// An error and its remedy.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct ErrorDetails<'a> {
    /// Kind of the error, in snake case.
    kind: &'a str,
    /// Error message: file, place, found and expected values.
    message: &'a str,
    /// How to fix the error.
    help: &'a str,
    /// Path of the affected file; null if no file is affected.
    file: Option<&'a str>,
    /// Place in the file; null if the error concerns the whole file.
    place: Option<&'a str>,
    /// Exit code of the program.
    exit_code: u8,
}

impl<'a> ErrorReport<'a> {
    /// Makes the report of a failure.
    pub fn of(failure: &'a Failure) -> Self {
        let Failure { kind, message, remedy, place, file, exit_code, .. } = failure;
        Self {
            error: ErrorDetails {
                kind,
                message,
                help: remedy,
                file: file.as_deref(),
                place: place.as_deref(),
                exit_code: *exit_code,
            },
        }
    }
}

/// Prints an error as JSON, to stderr if stdout is an output file.
pub(super) fn print_failure(failure: &Failure, to_stderr: bool) {
    let Ok(Outcome { json, .. }) = Outcome::new("error", &ErrorReport::of(failure), String::new())
    else {
        return;
    };
    let text = serde_json::to_string_pretty(&json).unwrap_or_default() + "\n";
    match to_stderr {
        true => say(text.trim_end()),
        // An error of stdout itself is already on stderr.
        false => drop(write_stdout(text.as_bytes())),
    }
}
