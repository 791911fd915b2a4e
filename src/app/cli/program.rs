//! Parses the arguments and runs the verb.

use std::borrow::Cow;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use super::common::{Common, Format, When};
use super::outcome::{print, say};
use super::{
    attach, bake, compare, detach, document, inspect, interrupt, render, sweep, unpack, validate,
    view,
};
use crate::base::error::{Error, ErrorKind};
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

/// Parses arguments, runs the verb, prints its report and returns the exit code: 0 done, 1
/// findings, a gate missed or a setting that failed, 2 wrong usage, 3 malformed input, 4 unknown
/// version or feature, 5 input or output failed, 6 over a limit.
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
    interrupt::watch();
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
        Verb::Completions(arguments) => {
            document::completions(arguments, Cli::command()).map(|()| None)
        }
        Verb::Man => document::man(&Cli::command()).map(|()| None),
    });
    let outcome = outcome.and_then(|outcome| outcome);
    let printed = outcome.and_then(|outcome| {
        let Some(outcome) = outcome else { return Ok(ExitCode::SUCCESS) };
        print(&outcome, common)?;
        Ok(ExitCode::from(u8::from(outcome.failed)))
    });
    printed.unwrap_or_else(|error| {
        let bold = common.color == When::Always
            || (common.color == When::Auto && std::io::IsTerminal::is_terminal(&std::io::stderr()));
        let (red, plain) = if bold { ("\x1b[1;31m", "\x1b[0m") } else { ("", "") };
        say(&format!("{red}error:{plain} {}\n  help: {}", message(&error), remedy(&error)));
        ExitCode::from(exit_code(error.kind()))
    })
}

/// The error as users of the command line read it: the library's options have flags here.
fn message(error: &Error) -> String {
    let ErrorKind::InvalidOption { option, .. } = error.kind() else { return error.to_string() };
    error.to_string().replacen(
        &format!("option {option}: "),
        &format!("--{}: ", option.replace('_', "-")),
        1,
    )
}

/// The remedy, by the names of options on the command line.
fn remedy(error: &Error) -> Cow<'static, str> {
    match error.kind() {
        ErrorKind::OverLimit { .. } => format!("{}: see --limit", error.remedy()).into(),
        ErrorKind::TooLittleMemory { least, .. } => {
            format!("pass --memory {least} or more, or fewer --threads").into()
        }
        ErrorKind::NonFinite { .. } => {
            "retrain, or pass --nonfinite empty to treat these values as empty".into()
        }
        ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => "see --help".into(),
        ErrorKind::Exists => "pass --force to overwrite it".into(),
        _ => error.remedy(),
    }
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
