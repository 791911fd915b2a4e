//! Verbs as functions for programs that embed this library, such as the Python module: their
//! inputs, and the errors of failed verbs.

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;

use super::failure::{exit_code, message, remedy};
use super::view_report::ColorFit;
use super::watcher::SharedWatcher;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place};

/// A verb to run.
#[derive(Debug, Default)]
pub struct Call {
    /// The verb and its arguments, without the program's name.
    pub arguments: Vec<OsString>,
    /// Bytes in memory, as the input of a bake with the argument `-`.
    pub input: Option<Arc<SourceFile>>,
    /// The fit behind the colours of that input.
    pub color_fit: Option<ColorFit>,
    /// The watcher of the work.
    pub watcher: Option<SharedWatcher>,
}

/// A failed verb, with the program's messages.
#[derive(Debug)]
pub struct Failure {
    /// Its kind in snake case: the error's, or `gate` for a missed gate.
    pub kind: &'static str,
    /// The file, the place, the thing found and the thing expected.
    pub message: String,
    /// The remedy, in a sentence.
    pub remedy: String,
    /// The place in the file, unless the error is about all of it.
    pub place: Option<String>,
    /// The file, if the error is about one.
    pub file: Option<String>,
    /// The program's exit code for it.
    pub exit_code: u8,
    /// The report of a verb that did its work, but missed a gate.
    pub report: Option<Value>,
}

impl Failure {
    /// Of an error.
    pub fn of(error: &Error) -> Box<Self> {
        let place = Some(error.place()).filter(|place| **place != Place::File);
        Box::new(Self {
            kind: error.kind().name(),
            message: message(error),
            remedy: remedy(error).into_owned(),
            place: place.map(ToString::to_string),
            file: error.file().map(Path::to_string_lossy).map(Into::into),
            exit_code: exit_code(error.kind()),
            report: None,
        })
    }

    /// For arguments that cannot be parsed, with the parser's message.
    pub(super) fn of_arguments(words: &str) -> Box<Self> {
        let words = words.trim();
        let message = words.split("\n\nUsage:").next().unwrap_or(words);
        let message = message.trim_start_matches("error: ").to_owned();
        Box::new(Self { message, ..*Self::of(&Error::usage("")) })
    }

    /// For a command line with a known mistake.
    pub(super) fn of_mistake(message: &str, help: &str) -> Box<Self> {
        Self::of(&Error::usage(message).advise(help.to_owned()))
    }

    /// For a missed gate.
    pub(super) fn of_gate(reason: String, report: Value) -> Box<Self> {
        let remedy = "lower the gate, or raise the quality".to_owned();
        let (kind, report) = ("gate", Some(report));
        let (message, place, file) = (reason, None, None);
        Box::new(Self { kind, message, remedy, place, file, exit_code: 1, report })
    }
}
