//! The content of `-h` and `--help`.
//!
//! `-h` shows the options of [`SHORT`] with their first clauses. `--help` shows all options of a
//! verb, but only one verb ([`HOME`], or the program for general options) explains shared options;
//! the others name them. Completions, the manual page and Python have all options.

use clap::builder::StyledStr;
use clap::{Arg, Command};

use super::layout::folded;

/// The most common options, by verb. Other verbs show all of theirs.
const SHORT: [(&str, &[&str]); 9] = [
    (
        "bake",
        &[
            "output",
            "preset",
            "quality",
            "max-bytes",
            "stepsize",
            "near",
            "far",
            "cameras",
            "require_psnr",
            "gltf",
            "dry_run",
            "force",
        ],
    ),
    (
        "transcode",
        &["output", "max_bytes", "bits", "without_finest", "crop", "drop_islands", "force"],
    ),
    ("unpack", &["output", "levels", "slices", "force"]),
    (
        "render",
        &["output", "cameras", "turntable", "frames", "size", "scales", "alpha", "fps", "force"],
    ),
    (
        "compare",
        &[
            "output",
            "cameras",
            "turntable",
            "frames",
            "size",
            "scales",
            "difference",
            "stepsize",
            "near",
            "far",
        ],
    ),
    ("probe", &["rays", "output", "positions", "level_of_detail", "force"]),
    (
        "sweep",
        &[
            "output",
            "filter",
            "bits",
            "max-error",
            "preset",
            "cameras",
            "turntable",
            "frames",
            "size",
            "stepsize",
            "dry_run",
        ],
    ),
    (
        "export",
        &[
            "to",
            "output",
            "level",
            "supersample",
            "resolution",
            "crop",
            "triangles",
            "splats",
            "cameras",
            "require_psnr",
            "force",
        ],
    ),
    ("validate", &["stepsize", "max_findings"]),
];

/// The meaning of a shared option for one verb: verb, option, help.
const OWN_WORDS: [(&str, &str, &str); 1] = [(
    "export",
    "resolution",
    "Cubic cells along the longest axis, instead of the field's voxels; a model without a grid is \
     sampled at as many",
)];

/// The verb that explains shared options.
const HOME: &str = "bake";
/// Headings of options that verbs share with [`HOME`].
const SHARED: [&str; 2] = ["Scene", "Cameras"];
/// The heading of options of all verbs, which the program explains.
const GENERAL: &str = "General";
/// Columns of help.
const WIDTH: usize = 100;

/// The program with arranged help.
pub fn arrange(mut program: Command) -> Command {
    // A number below 0 is then refused with its range, not as an unknown option.
    program = program.mut_subcommands(|verb| {
        verb.mut_args(|own| match own.get_action().takes_values() && !own.is_positional() {
            true => own.allow_negative_numbers(true),
            false => own,
        })
    });
    let home = program.find_subcommand(HOME).into_iter().flat_map(Command::get_arguments);
    let shared: Vec<String> = home
        .filter(|own| own.get_help_heading().is_some_and(|heading| SHARED.contains(&heading)))
        .map(id)
        .collect();
    let general: Vec<Arg> =
        program.get_arguments().filter(|own| is_general(own)).cloned().collect();
    program = program.mut_subcommands(|verb| {
        let mut verb = short(verb);
        let mut named = Vec::new();
        if verb.get_name() != HOME {
            for heading in SHARED {
                let is_named = |own: &Arg| {
                    own.get_help_heading() == Some(heading)
                        && shared.contains(&id(own))
                        && !is_short(verb.get_name(), own)
                };
                let hidden: Vec<Arg> =
                    verb.get_arguments().filter(|own| is_named(own)).cloned().collect();
                if hidden.is_empty() {
                    continue;
                }
                named.push((heading, "mipvog-bake bake --help", names(&hidden)));
                for own in &hidden {
                    verb = verb.mut_arg(id(own), |own| own.hide(true));
                }
            }
        }
        named.push((GENERAL, "mipvog-bake --help", names(&general)));
        let verb = verb.args(general.iter().map(|own| own.clone().hide(true)));
        with_names(verb, &named)
    });
    program.mut_args(|own| {
        let is_first = ["format", "quiet"].contains(&own.get_id().as_str());
        let is_hidden = is_general(&own) && !is_first;
        // Its help names them.
        let names_values = own.get_id() == "format";
        shortened(own).hide_short_help(is_hidden).hide_possible_values(names_values)
    })
}

fn id(own: &Arg) -> String {
    own.get_id().to_string()
}

fn is_general(own: &Arg) -> bool {
    own.get_help_heading() == Some(GENERAL)
}

/// True if `-h` of the verb shows this argument.
fn is_short(verb: &str, own: &Arg) -> bool {
    let shown = SHORT.iter().find(|(name, _)| *name == verb);
    own.get_long().is_none()
        || shown.is_none_or(|(_, shown)| shown.contains(&own.get_id().as_str()))
}

/// A verb with its most important options in `-h`, and its own help for shared options.
fn short(verb: Command) -> Command {
    let name = verb.get_name().to_owned();
    verb.mut_args(|own| {
        let is_shown = is_short(&name, &own);
        let words = OWN_WORDS.iter().find(|(verb, id, _)| *verb == name && own.get_id() == *id);
        let own = match words {
            Some((.., words)) => own.help(*words).long_help(*words),
            None => own,
        };
        shortened(own).hide_short_help(!is_shown)
    })
}

/// An argument with the first clause of its help in `-h`.
fn shortened(own: Arg) -> Arg {
    let Some(whole) = own.get_long_help().or(own.get_help()).map(StyledStr::to_string) else {
        return own;
    };
    own.help(first_clause(&whole)).long_help(whole)
}

/// The first clause of a help text, and its default.
fn first_clause(whole: &str) -> String {
    let (text, default) = whole.split_once(" [default: ").map_or((whole, None), |(text, rest)| {
        (text, Some(rest.split_once(']').map_or(rest, |(default, _)| default)))
    });
    let ends = ["; ", ". ", "\n"].into_iter().filter_map(|end| text.find(end));
    let clause = &text[..ends.min().unwrap_or(text.len())];
    // A default of several clauses is shown only in `--help`.
    match default.filter(|default| !default.contains([';', ','])) {
        Some(default) => format!("{clause} [default: {default}]"),
        None => clause.to_owned(),
    }
}

fn names(options: &[Arg]) -> String {
    let names = options.iter().filter_map(Arg::get_long).map(|name| format!("--{name}"));
    names.collect::<Vec<_>>().join(", ")
}

/// Names options below the examples of `--help`, and the help that explains them.
fn with_names(verb: Command, named: &[(&str, &str, String)]) -> Command {
    let examples = verb.get_after_help().map(StyledStr::to_string).unwrap_or_default();
    let mut text = examples.trim_end().to_owned();
    for (heading, place, names) in named {
        let line = folded(&format!("  {names}"), WIDTH, 2);
        let heading = heading.strip_suffix('s').unwrap_or(heading);
        text += &format!("\n\n{heading} options, which `{place}` explains:\n{line}");
    }
    verb.after_long_help(text.trim_start().to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::super::program::Cli;
    use super::*;

    #[test]
    fn every_name_of_a_short_help_is_an_option() {
        let program = Cli::command();
        for (name, shown) in SHORT {
            let verb = program.find_subcommand(name).expect(name);
            for option in shown {
                let own = verb.get_arguments().find(|own| own.get_id() == *option);
                assert!(own.is_some_and(|own| own.get_long().is_some()), "{name}: {option}");
            }
        }
        for (name, option, _) in OWN_WORDS {
            let verb = program.find_subcommand(name).expect(name);
            assert!(verb.get_arguments().any(|own| own.get_id() == option), "{name}: {option}");
        }
    }

    #[test]
    fn a_first_clause_keeps_a_short_default() {
        assert_eq!(
            first_clause("Bits per value; more [default: 8]"),
            "Bits per value [default: 8]"
        );
        assert_eq!(first_clause("Do it. With care"), "Do it");
        assert_eq!(first_clause("Step [default: from a; else b]"), "Step");
    }
}
