//! The report of a verb, and its printing.

use std::io::{ErrorKind as IoErrorKind, IsTerminal, Write};
use std::sync::Mutex;

use indicatif::ProgressBar;
use serde::Serialize;

use super::common::{Common, Format};
use super::layout::{folded, message_columns};
use crate::base::error::{Error, Result};
use crate::base::lock::{Locked, lock};

/// A verb's output.
pub(super) struct Outcome {
    /// For people.
    pub(super) text: String,
    /// For programs.
    pub(super) json: serde_json::Value,
    /// For programs that gather findings of many tools.
    pub(super) sarif: Option<serde_json::Value>,
    /// The reason of exit code 1: the verb did its work, but a file or a gate failed.
    pub(super) failure: Option<String>,
}

/// Members of reports that people type. Others are exact: bounds of errors hold as they are stated.
const AS_TYPED: [&str; 2] = ["options", "settings"];

/// Without the digits that float32 cannot hold: a number that is one has its shortest text.
fn shortened(value: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::Number(number) if number.is_f64() => {
            let exact = number.as_f64().unwrap_or_default();
            #[expect(clippy::cast_possible_truncation, reason = "compared with what it was")]
            let short = exact as f32;
            let is_short = f64::from(short) == exact;
            let shown = is_short.then(|| short.to_string().parse::<f64>().ok()).flatten();
            shown.map_or(Value::Number(number), Value::from)
        }
        Value::Array(values) => values.into_iter().map(shortened).collect(),
        Value::Object(members) => {
            members.into_iter().map(|(key, value)| (key, shortened(value))).collect()
        }
        other => other,
    }
}

impl Outcome {
    /// A report under the schema of its verb.
    pub(super) fn new(verb: &str, report: &impl Serialize, text: String) -> Result<Self> {
        let mut json = serde_json::Map::new();
        json.insert("schema".to_owned(), format!("mipvog-{verb}/1").into());
        let report = serde_json::to_value(report)
            .map_err(|error| Error::usage(format!("the report is not JSON: {error}")))?;
        if let serde_json::Value::Object(report) = report {
            json.extend(report.into_iter().map(|(key, value)| match AS_TYPED.contains(&&*key) {
                true => (key, shortened(value)),
                false => (key, value),
            }));
        }
        Ok(Self { text, json: json.into(), sarif: None, failure: None })
    }

    /// Adds the warnings of the run, which cause a failure if warnings are denied.
    pub(super) fn with_warnings(mut self, common: &Common) -> Self {
        if let serde_json::Value::Object(report) = &mut self.json {
            report.insert("warnings".to_owned(), common.warnings.texts().into());
            self.failure = self.failure.or_else(|| denied(common));
        }
        self
    }

    /// For a verb that has already printed its report.
    pub(super) fn reported(failure: Option<String>) -> Self {
        Self { text: String::new(), json: serde_json::Value::Null, sarif: None, failure }
    }
}

/// Prints a report to stdout, or to stderr if stdout is an output file.
pub(super) fn print(outcome: &Outcome, common: &Common, to_stderr: bool) -> Result<()> {
    let text = match common.format {
        _ if outcome.json.is_null() => return Ok(()),
        Format::Text if common.quiet => return Ok(()),
        Format::Text => outcome.text.clone(),
        Format::Json | Format::Sarif => {
            let json = match (&outcome.sarif, common.format) {
                (Some(sarif), Format::Sarif) => sarif,
                _ => &outcome.json,
            };
            let text = serde_json::to_string_pretty(json)
                .map_err(|error| Error::usage(format!("the report is not JSON: {error}")))?;
            text + "\n"
        }
    };
    if to_stderr {
        say(text.trim_end());
        return Ok(());
    }
    write_stdout(text.as_bytes())
}

/// Writes to stdout. A closed pipe is not an error, because its reader has read enough.
pub(super) fn write_stdout(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == IoErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Error::io(error, std::path::Path::new("stdout"))),
        Ok(()) => Ok(()),
    }
}

/// The message for an assumed setting, with flags for the library's options: `option NAME` becomes
/// `--NAME`, and `option NAME: VALUE` becomes `--NAME VALUE`.
pub(super) fn assumed(message: &str) -> String {
    let mut parts = message.split("option ");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|letter: char| !letter.is_ascii_lowercase() && !"-_".contains(letter));
        let (name, rest) = part.split_at(end.unwrap_or(part.len()));
        text += &format!("--{}{}", name.replace('_', "-"), rest.strip_prefix(':').unwrap_or(rest));
    }
    text
}

/// The reason to fail if warnings are denied and there are any.
pub(super) fn denied(common: &Common) -> Option<String> {
    let count = common.warnings.texts().len();
    (common.deny_warnings && count > 0)
        .then(|| format!("{}, and --deny-warnings is set", counted(count, "warning")))
}

/// A warning on stderr, and in the report.
pub(super) fn warn(message: &str, common: &Common) {
    if let Some(message) = common.warnings.add(message)
        && !common.quiet
    {
        say(&folded_for_people(&format!("warning: {message}")));
    }
}

/// Wraps a message to the terminal. Programs get it unchanged.
pub(super) fn folded_for_people(message: &str) -> String {
    match std::io::stderr().is_terminal() {
        true => folded(message, message_columns(), 4),
        false => message.to_owned(),
    }
}

/// Writes a line to stderr, above the progress bar. Errors of stderr are ignored, because there is
/// no other place for the message.
pub(super) fn say(line: &str) {
    let write = || {
        writeln!(std::io::stderr(), "{line}").ok();
    };
    match &*drawn() {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// The bar that is drawn on stderr, if any.
pub(super) fn drawn() -> Locked<'static, Option<ProgressBar>> {
    static DRAWN: Mutex<Option<ProgressBar>> = Mutex::new(None);
    lock(&DRAWN)
}

/// A count and its noun.
pub(super) fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

/// Bytes in a readable unit.
pub(super) fn readable(bytes: u64) -> String {
    let units = ["B", "kB", "MB", "GB", "TB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1000.0 && unit + 1 < units.len() {
        value /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.2} {}", units[unit]) }
}

/// Peak resident memory of this process, if the operating system reports it.
pub(super) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_the_library_are_flags() {
        let cases = [
            ("a mask; pass the file as option coarse", "a mask; pass the file as --coarse"),
            ("(option mlp: none leaves it out)", "(--mlp none leaves it out)"),
            ("black; option drop_background, option view", "black; --drop-background, --view"),
            ("no setting", "no setting"),
        ];
        for (message, expected) in cases {
            assert_eq!(assumed(message), expected);
        }
    }
}
