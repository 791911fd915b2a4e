//! The command line: arguments in, reports on stdout, progress and warnings on stderr.
//!
//! One file a verb. Verbs return what they report; printing and exit codes are here.

mod attach;
mod bake;
mod compare;
mod detach;
mod document;
mod field;
mod fit;
mod gate;
mod gltf;
mod incremental;
mod inspect;
mod interrupt;
mod progress;
mod render;
mod stored;
mod sweep;
mod unpack;
mod validate;
mod values;
mod view;

use std::io::{ErrorKind as IoErrorKind, Write};
use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use serde::Serialize;

use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::Limits;
use crate::base::parallel;

/// Bakes trained Mip-VoG radiance fields into sparse, quantized, coarse-to-fine assets.
#[derive(Debug, Parser)]
#[command(name = "mipvog-bake", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Bake(Box<bake::Arguments>),
    Inspect(inspect::Arguments),
    Validate(validate::Arguments),
    Unpack(unpack::Arguments),
    Render(render::Arguments),
    Compare(compare::Arguments),
    Sweep(Box<sweep::Arguments>),
    Attach(attach::Arguments),
    Detach(detach::Arguments),
    View(view::Arguments),
    Completions(document::CompletionArguments),
    Man,
}

/// What all verbs share.
#[derive(Debug, Args)]
struct Common {
    /// How to print reports
    #[arg(long, global = true, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// Threads to use; 0 is one for each processor
    #[arg(long, global = true, value_name = "N", default_value_t = 0,
          value_parser = clap::value_parser!(u16).range(0..=256))]
    threads: u16,
    /// Raise or lower a limit on what files may ask for, such as memory=1000000000; can be given again. An unknown
    /// name lists all
    #[arg(long = "limit", global = true, value_name = "NAME=COUNT", value_parser = values::parse_limit)]
    limits: Vec<(String, u64)>,
    /// Print no report, no progress and no warnings
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Print more: every stage, every block statistic
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    verbose: bool,
    /// Colour in error messages
    #[arg(long, global = true, value_enum, default_value_t = When::Auto)]
    color: When,
    /// Progress bars on stderr; auto is on a terminal only
    #[arg(long, global = true, value_enum, default_value_t = When::Auto)]
    progress: When,
}

impl Common {
    /// Limits on what files may ask for.
    fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        for (name, count) in &self.limits {
            let mut named = limits.named();
            if let Some((_, _, limit)) = named.iter_mut().find(|(own, ..)| own == name) {
                **limit = *count;
            }
        }
        limits
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
    /// A SARIF 2.1.0 log, of `validate` alone.
    Sarif,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum When {
    Auto,
    Always,
    Never,
}

/// What a verb has to say.
struct Outcome {
    /// For people.
    text: String,
    /// For programs.
    json: serde_json::Value,
    /// For programs that gather findings of many tools.
    sarif: Option<serde_json::Value>,
    /// Whether the file or the gate failed, though the verb did its work.
    failed: bool,
}

impl Outcome {
    /// A report under the schema of its verb.
    fn new(verb: &str, report: &impl Serialize, text: String) -> Result<Self> {
        let mut json = serde_json::Map::new();
        json.insert("schema".to_owned(), format!("mipvog-{verb}/1").into());
        let report = serde_json::to_value(report)
            .map_err(|error| Error::usage(format!("the report is no JSON: {error}")))?;
        if let serde_json::Value::Object(report) = report {
            json.extend(report);
        }
        Ok(Self { text, json: json.into(), sarif: None, failed: false })
    }
}

/// Parses arguments, runs the verb, prints its report and returns the exit code:
/// 0 done, 1 findings, a gate missed or a setting that failed, 2 wrong usage, 3 malformed input, 4 unknown version or
/// feature, 5 input or output failed, 6 over a limit.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no errors; a closed pipe under them is none either.
            let code = if error.use_stderr() { 2 } else { 0 };
            error.print().ok();
            return ExitCode::from(code);
        }
    };
    let common = &cli.common;
    interrupt::outlive_file_limits();
    let outcome = parallel::with_threads(common.threads.into(), || match &cli.verb {
        verb if common.format == Format::Sarif && !matches!(verb, Verb::Validate(_)) => {
            Err(Error::usage("--format sarif: only validate has findings"))
        }
        Verb::Bake(arguments) => bake::run(arguments, common).map(Some),
        Verb::Inspect(arguments) => inspect::run(arguments, &common.limits()).map(Some),
        Verb::Validate(arguments) => validate::run(arguments, &common.limits()).map(Some),
        Verb::Unpack(arguments) => unpack::run(arguments, common).map(Some),
        Verb::Render(arguments) => render::run(arguments, common).map(Some),
        Verb::Compare(arguments) => compare::run(arguments, common).map(Some),
        Verb::Sweep(arguments) => sweep::run(arguments, common).map(Some),
        Verb::Attach(arguments) => attach::run(arguments, common).map(Some),
        Verb::Detach(arguments) => detach::run(arguments, common).map(Some),
        Verb::View(arguments) => view::run(arguments, common).map(|()| None),
        Verb::Completions(arguments) => document::completions(arguments).map(|()| None),
        Verb::Man => document::man().map(|()| None),
    });
    let printed = outcome.and_then(|outcome| {
        let Some(outcome) = outcome else { return Ok(ExitCode::SUCCESS) };
        print(&outcome, common)?;
        Ok(ExitCode::from(u8::from(outcome.failed)))
    });
    printed.unwrap_or_else(|error| {
        let bold = common.color == When::Always
            || (common.color == When::Auto && std::io::IsTerminal::is_terminal(&std::io::stderr()));
        let (red, plain) = if bold { ("\x1b[1;31m", "\x1b[0m") } else { ("", "") };
        say(&format!("{red}error:{plain} {error}\n  help: {}", error.remedy()));
        ExitCode::from(exit_code(error.kind()))
    })
}

fn exit_code(kind: &ErrorKind) -> u8 {
    match kind {
        ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => 2,
        ErrorKind::Truncated { .. }
        | ErrorKind::Overflow { .. }
        | ErrorKind::Checksum { .. }
        | ErrorKind::Malformed { .. }
        | ErrorKind::NonFinite { .. } => 3,
        ErrorKind::Unsupported { .. } => 4,
        ErrorKind::Io(_) | ErrorKind::Exists => 5,
        ErrorKind::OverLimit { .. } | ErrorKind::TooLittleMemory { .. } => 6,
        ErrorKind::Cancelled => interrupt::cancelled(),
    }
}

fn print(outcome: &Outcome, common: &Common) -> Result<()> {
    let text = match common.format {
        Format::Text if common.quiet => return Ok(()),
        Format::Text => outcome.text.clone(),
        Format::Json | Format::Sarif => {
            let json = match (&outcome.sarif, common.format) {
                (Some(sarif), Format::Sarif) => sarif,
                _ => &outcome.json,
            };
            let text = serde_json::to_string_pretty(json)
                .map_err(|error| Error::usage(format!("the report is no JSON: {error}")))?;
            text + "\n"
        }
    };
    write_stdout(text.as_bytes())
}

/// Writes to stdout; whoever closed the pipe has read enough.
fn write_stdout(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == IoErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Error::io(error, std::path::Path::new("stdout"))),
        Ok(()) => Ok(()),
    }
}

/// A warning on stderr.
fn warn(message: &str, common: &Common) {
    if !common.quiet {
        say(&format!("warning: {message}"));
    }
}

/// A line on stderr. Where nobody can read it there is nobody to tell.
fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").ok();
}

fn command() -> clap::Command {
    Cli::command()
}

/// Bytes in the unit that people read.
fn readable(bytes: u64) -> String {
    let units = ["B", "kB", "MB", "GB", "TB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1000.0 && unit + 1 < units.len() {
        value /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.2} {}", units[unit]) }
}
