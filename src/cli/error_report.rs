//! An error as `--format json` prints it.

use serde::Serialize;

use super::call::Failure;
use super::outcome::{Outcome, say, write_stdout};

/// What is printed in place of a report.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ErrorReport<'a> {
    error: ErrorDetails<'a>,
}

#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct ErrorDetails<'a> {
    /// Its kind in snake case.
    kind: &'a str,
    /// The file, the place, what was found and what was expected.
    message: &'a str,
    /// What to do.
    help: &'a str,
    /// The file, if the error is about one.
    file: Option<&'a str>,
    /// The place in the file, unless the error is about all of it.
    place: Option<&'a str>,
    /// The exit code of the program.
    exit_code: u8,
}

impl<'a> ErrorReport<'a> {
    /// Of a failure.
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
