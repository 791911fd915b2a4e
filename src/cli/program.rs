//! Parses the arguments and runs the verb.

use std::cell::RefCell;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use clap::{ArgMatches, ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand};

use super::call::{Call, Failure};
use super::common::{Common, Format, When};
use super::error_report::print_failure;
use super::failure::{exit_code, message, remedy};
use super::file_names::FileNames;
use super::guess::Mistaken;
use super::manifest::{BatchOptions, OptionKind, SceneLine, SceneResult, Words};
use super::outcome::{Outcome, folded_for_people, print, say, write_stdout};
use super::paint::{error_label, is_colored};
use super::{
    attach, bake, compare, detach, document, export, guess, help, inspect, interrupt, manifest,
    open, probe, render, report, shell, stdin, sweep, transcode, unpack, validate, view,
};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::parallel;
use crate::base::text::printable;

/// Opens a field; not a verb.
const OPEN: &str = "open";

/// Bake trained radiance fields (Mip-VoG, DirectVoxGO, Plenoxels, ...) into small files
///
/// The files stream coarse to fine and look right at any distance.
#[derive(Debug, Parser)]
#[command(name = "mipvog-bake", version, max_term_width = 100)]
#[command(after_help = "\
Examples:
  mipvog-bake bake fine_last.tar --stepsize 0.5 --near 2 --far 6 -o scene.mipvog
  mipvog-bake view scene.mipvog
  mipvog-bake compare fine_last.tar scene.mipvog --cameras transforms.json

`mipvog-bake VERB --help` explains a verb and its options.")]
pub(super) struct Cli {
    #[command(subcommand)]
    verb: Verb,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Bake(Box<bake::Arguments>),
    Transcode(transcode::Arguments),
    #[command(visible_alias = "info")]
    Inspect(inspect::Arguments),
    #[command(visible_alias = "check")]
    Validate(validate::Arguments),
    Unpack(unpack::Arguments),
    Render(render::Arguments),
    #[command(visible_alias = "diff")]
    Compare(compare::Arguments),
    Probe(probe::Arguments),
    Sweep(Box<sweep::Arguments>),
    Report(report::Arguments),
    Export(Box<export::Arguments>),
    Attach(attach::Arguments),
    Detach(detach::Arguments),
    #[command(visible_alias = "serve")]
    View(view::Arguments),
    Completions(document::CompletionArguments),
    /// Print the manual page
    Man,
    /// Print the version
    Version,
}

/// Parses arguments, runs the verb, prints its report and returns the exit code: 0 done, 1
/// findings, a gate missed or a setting that failed, 2 wrong usage, 3 malformed input, 4 unknown
/// version or feature, 5 input or output failed, 6 over a limit, 7 the output exists.
pub fn main() -> ExitCode {
    ExitCode::from(main_of(std::env::args_os().collect()))
}

/// [`main`] for a process with a different command line. The first argument is the program's name.
pub fn main_of(arguments: Vec<OsString>) -> u8 {
    shell::note_typed(&arguments);
    let (cli, matches) = match parse(&arguments) {
        Ok(parsed) => parsed,
        Err(error) => return refuse(&error, &arguments),
    };
    let common = &cli.common;
    interrupt::watch();
    let names = FileNames::of(&matches);
    let printed = outcome(&cli, &names).and_then(|outcome| {
        let Some(outcome) = outcome else { return Ok(0) };
        // The standard output holds the file then.
        print(&outcome, common, names.to_stdout)?;
        let Some(reason) = &outcome.failure else { return Ok(0) };
        let label = error_label(is_colored(common.color));
        say(&folded_for_people(&format!("{label} {reason}")));
        Ok(1)
    });
    let code = printed.unwrap_or_else(|error| {
        tell(&error, common);
        if common.format == Format::Json {
            print_failure(&Failure::of(&error), names.to_stdout);
        }
        exit_code(error.kind())
    });
    stdin::remove_copy();
    code
}

/// Prints an error to stderr.
fn tell(error: &Error, common: &Common) {
    let label = error_label(is_colored(common.color));
    let said = folded_for_people(&format!("{label} {}", printable(&message(error))));
    // Messages about options state the expected value.
    let is_of_options =
        matches!(error.kind(), ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. });
    if is_of_options && error.advice().is_none() {
        return say(&said);
    }
    let help = folded_for_people(&format!("  help: {}", printable(&remedy(error))));
    say(&format!("{said}\n{help}"));
}

/// Reports an invalid command line, and returns the exit code.
fn refuse(error: &clap::Error, arguments: &[OsString]) -> u8 {
    // Help and version are not errors, and neither is a closed pipe.
    if !error.use_stderr() {
        error.print().ok();
        return 0;
    }
    // The help of a command line without a verb.
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.print().ok();
        return Failure::of_arguments("").exit_code;
    }
    let mistaken = guess::mistaken(error, arguments, &Cli::command());
    let failure = match &mistaken {
        Some(Mistaken { message, help }) => Failure::of_mistake(message, help),
        None => Failure::of_arguments(&guess::words_of(error)),
    };
    match mistaken {
        Some(Mistaken { message, help }) => {
            let label = error_label(is_colored(color_of(arguments)));
            let said = folded_for_people(&format!("{label} {message}"));
            say(&format!("{said}\n{}", folded_for_people(&format!("  help: {help}"))));
        }
        None => {
            let label = error_label(is_colored(color_of(arguments)));
            say(&format!("{label} {}", guess::words_of(error)));
        }
    }
    if is_asked(arguments, "--format", "json") {
        print_failure(&failure, false);
    }
    failure.exit_code
}

/// Runs a verb for a program that embeds this library, with its arguments, an input in memory, and
/// the watcher of the work. The report of a verb without one is null.
///
/// # Errors
/// Unknown arguments, errors of the verb, and missed gates.
pub fn call(call: Call) -> std::result::Result<serde_json::Value, Box<Failure>> {
    let name = OsString::from("mipvog-bake");
    let arguments = std::iter::once(name).chain(call.arguments);
    let parsed = Cli::command().color(ColorChoice::Never).try_get_matches_from(arguments);
    let parsed = parsed.and_then(|matches| Ok((Cli::settled(&matches)?, matches)));
    let (mut cli, matches) = parsed.map_err(|error| Failure::of_arguments(&error.to_string()))?;
    cli.common.watcher = call.watcher;
    if let (Verb::Bake(arguments), Some(input)) = (&mut cli.verb, call.input) {
        arguments.held = Some(input);
        arguments.color_fit = call.color_fit;
    }
    let found = outcome(&cli, &FileNames::of(&matches));
    stdin::remove_copy();
    match found.map_err(|error| Failure::of(&error))? {
        None => Ok(serde_json::Value::Null),
        Some(Outcome { failure: Some(reason), json, .. }) => Err(Failure::of_gate(reason, json)),
        Some(outcome) => Ok(outcome.json),
    }
}

/// The long names of a verb's options, or of those of [`OpenField`](super::OpenField) under `open`,
/// and whether one can be given again.
pub fn option_names(verb: &str) -> Vec<(String, bool)> {
    let (program, field) = (Cli::command(), open::command());
    let own = if verb == OPEN { Some(&field) } else { program.find_subcommand(verb) };
    let Some(own) = own else { return Vec::new() };
    let kinds = own.get_arguments().chain(program.get_arguments()).filter_map(OptionKind::of);
    kinds.map(|kind| (kind.name, kind.again)).collect()
}

fn outcome(cli: &Cli, names: &FileNames) -> Result<Option<Outcome>> {
    let common = &cli.common;
    let _permit = common.network_permit();
    names.check()?;
    let outcome = parallel::with_threads(common.threads.into(), || run(&cli.verb, common))??;
    Ok(outcome.map(|outcome| outcome.with_warnings(common)))
}

fn parse(arguments: &[OsString]) -> std::result::Result<(Cli, ArgMatches), clap::Error> {
    let colored = is_colored(color_of(arguments));
    let choice = if colored { ColorChoice::Always } else { ColorChoice::Never };
    let matches = help::arrange(Cli::command()).color(choice).try_get_matches_from(arguments)?;
    Ok((Cli::settled(&matches)?, matches))
}

/// The colours of messages for an invalid command line.
fn color_of(arguments: &[OsString]) -> When {
    match () {
        () if is_asked(arguments, "--color", "always") => When::Always,
        () if is_asked(arguments, "--color", "never") => When::Never,
        () => When::Auto,
    }
}

/// True if possibly invalid arguments set an option to this value.
fn is_asked(arguments: &[OsString], option: &str, value: &str) -> bool {
    let joined = format!("{option}={value}");
    let apart = |pair: &[OsString]| matches!(pair, [name, own] if name == option && own == value);
    arguments.iter().any(|argument| *argument == *joined) || arguments.windows(2).any(apart)
}

impl Cli {
    /// The arguments, with folders replaced by the files in them.
    fn settled(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let mut cli = Self::from_arg_matches(matches)?;
        if let Verb::Bake(arguments) = &mut cli.verb {
            arguments.settle();
        }
        Ok(cli)
    }
}

fn run(verb: &Verb, common: &Common) -> Result<Option<Outcome>> {
    if common.format == Format::Sarif && !matches!(verb, Verb::Validate(_)) {
        return Err(Error::usage("--format sarif: only validate has findings"));
    }
    match verb {
        Verb::Bake(arguments) => match &arguments.many.manifest {
            None if arguments.inputs.len() > 1 => bake_several(arguments, common).map(Some),
            None => bake::run(arguments, common).map(Some),
            Some(manifest) => {
                let scene = |words| bake_scene(words, common);
                let command = RefCell::new(command());
                let check = |words| check_scene(words, &mut command.borrow_mut());
                let batch = BatchOptions {
                    manifest,
                    arguments: &arguments.many,
                    given: &arguments.given,
                    outputs: &arguments.output,
                    force: arguments.force,
                    check: &check,
                };
                manifest::run(&batch, &bake_options(), common, &scene).map(Some)
            }
        },
        Verb::Transcode(arguments) => transcode::run(arguments, common).map(Some),
        Verb::Inspect(arguments) => inspect::run(arguments, common).map(Some),
        Verb::Validate(arguments) => validate::run(arguments, common).map(Some),
        Verb::Unpack(arguments) => unpack::run(arguments, common).map(Some),
        Verb::Render(arguments) => render::run(arguments, common).map(Some),
        Verb::Compare(arguments) => compare::run(arguments, common).map(Some),
        Verb::Probe(arguments) => probe::run(arguments, common).map(Some),
        Verb::Report(arguments) => report::run(arguments).map(Some),
        Verb::Sweep(arguments) => sweep::run(arguments, common).map(Some),
        Verb::Export(arguments) => export::run(arguments, common).map(Some),
        Verb::Attach(arguments) => attach::run(arguments, common).map(Some),
        Verb::Detach(arguments) => detach::run(arguments, common).map(Some),
        Verb::View(arguments) => view::run(arguments, common).map(|()| None),
        Verb::Completions(arguments) => {
            document::completions(arguments, Cli::command()).map(|()| None)
        }
        Verb::Man => document::man(&Cli::command()).map(|()| None),
        Verb::Version => document::version(&Cli::command()).map(|()| None),
    }
}

/// The program's arguments, for generated words.
fn command() -> clap::Command {
    Cli::command().color(ColorChoice::Never)
}

/// The arguments of one scene of several, whose options are words of a command line.
fn scene_arguments(
    words: Vec<OsString>,
    command: &mut clap::Command,
) -> Result<(Box<bake::Arguments>, ArgMatches)> {
    let parsed = command.try_get_matches_from_mut(words);
    let parsed = parsed.and_then(|matches| Ok((Cli::settled(&matches)?, matches)));
    let (cli, matches) = parsed.map_err(|error| {
        let text = error.to_string();
        let reason = text.split("\n\n").next().unwrap_or_default();
        Error::usage(reason.trim_start_matches("error: ").trim())
    })?;
    match cli.verb {
        Verb::Bake(arguments) => Ok((arguments, matches)),
        _ => Err(Error::usage("found another verb, expected bake")),
    }
}

/// Refuses values of a scene's options before anything is baked.
fn check_scene(words: Vec<OsString>, command: &mut clap::Command) -> Result<()> {
    scene_arguments(words, command)?.0.check_values()
}

fn bake_scene(words: Vec<OsString>, common: &Common) -> Result<Outcome> {
    let (arguments, matches) = scene_arguments(words, &mut command())?;
    let names = FileNames::of(&matches);
    names.check()?;
    bake::run(&arguments, common)
}

/// Bakes several inputs, one after another; one that fails does not stop the others.
fn bake_several(arguments: &bake::Arguments, common: &Common) -> Result<Outcome> {
    let outputs = arguments.outputs()?;
    let known = bake_options();
    let words = Words { given: &arguments.given, known: &known, outputs: Path::new("") };
    let (count, mut failed) = (outputs.len(), 0);
    for (input, output) in arguments.inputs.iter().zip(&outputs) {
        let clock = Instant::now();
        common.warnings.begin(&input.display().to_string());
        let line = SceneLine::of(input, output)?;
        let outcome = bake_scene(words.of(&line), common);
        if let Err(error) = &outcome
            && matches!(error.kind(), ErrorKind::Cancelled)
        {
            return outcome;
        }
        let result = SceneResult::of(&line, &outcome, clock.elapsed().as_secs_f64(), common);
        failed += u64::from(result.is_failed());
        match (common.format, &outcome) {
            (Format::Text, Ok(outcome)) => {
                print(outcome, common, false)?;
                if let Some(reason) = &outcome.failure {
                    say(&format!("{} {reason}", error_label(is_colored(common.color))));
                }
            }
            (Format::Text, Err(error)) => tell(error, common),
            _ => write_stdout(result.line()?.as_bytes())?,
        }
    }
    let failure = format!("{failed} of {count} inputs could not be baked");
    Ok(Outcome::reported((failed > 0).then_some(failure)))
}

/// The options of `bake`.
fn bake_options() -> Vec<OptionKind> {
    let program = Cli::command();
    let own = program.find_subcommand("bake").into_iter().flat_map(clap::Command::get_arguments);
    own.filter_map(OptionKind::of).collect()
}
