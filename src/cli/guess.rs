//! First guesses: command lines that people type before reading the help. They work, or the message
//! says what to type.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use clap::error::{ContextKind, ContextValue, ErrorKind as Mistake};

use super::output::STANDARD_STREAM;
use super::shell;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::container::is_container;
use crate::formats::{OF_MESHES, is_mesh};
use mipvog_outputs::gltf::asset::is_asset;

/// Messages of parsing numbers, and what they mean.
const PARSING: [(&str, &str); 4] = [
    ("invalid float literal", "expected a number"),
    ("invalid digit found in string", "expected a whole number, 0 or more"),
    ("cannot parse integer from empty string", "expected a whole number"),
    ("invalid IP address syntax", "expected an IP address such as 127.0.0.1"),
];
/// Options of `bake` that it takes for containers, too, and `transcode` does not have.
const OF_CONTAINERS: [&str; 10] = [
    "bits",
    "quality",
    "preset",
    "lod-rule",
    "lod-scale",
    "near",
    "far",
    "background",
    "filter",
    "alpha-threshold",
];
/// A mistake on the command line, with a better message than the parser's.
pub struct Mistaken {
    /// The mistake.
    pub message: String,
    /// The remedy.
    pub help: String,
}

/// An attempt that people expect to work.
pub fn mistaken(
    error: &clap::Error,
    words: &[OsString],
    program: &clap::Command,
) -> Option<Mistaken> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => texts.first().cloned(),
        _ => None,
    };
    match error.kind() {
        Mistake::InvalidSubcommand => {
            let word = text(ContextKind::InvalidSubcommand)?;
            a_file_alone(&word).or_else(|| an_option_alone(&word, program))
        }
        Mistake::UnknownArgument => {
            let word = text(ContextKind::InvalidArg)?;
            let (at, verb) = verb_of(words, program)?;
            if verb.get_name() == "report" && ["--to", "-o", "--output"].contains(&&*word) {
                return Some(Mistaken {
                    message: format!("report has no option {word}"),
                    help: "--junit FILE.xml writes the results as JUnit's XML".to_owned(),
                });
            }
            match word.strip_prefix("--") {
                Some(name) => an_option_of_others(name, verb, (at, words), program),
                None if word.starts_with('-') => None,
                None => a_second_path(&word, verb, words),
            }
        }
        Mistake::InvalidValue => {
            let value = text(ContextKind::InvalidValue)?;
            let of_format = text(ContextKind::InvalidArg)?.starts_with("--to ");
            (of_format && is_mesh(&value)).then(|| Mistaken {
                message: format!("--to {value}: found a format that is not written"),
                help: OF_MESHES.to_owned(),
            })
        }
        Mistake::MissingRequiredArgument => {
            let (at, verb) = verb_of(words, program)?;
            let missing = text(ContextKind::InvalidArg)?;
            let rest = words.get(at + 1..).unwrap_or_default();
            if rest.iter().all(|word| word.to_string_lossy().starts_with('-')) {
                return None;
            }
            match (missing.starts_with("--output"), verb.get_name()) {
                (false, _) => None,
                (true, "bake") => no_output(rest),
                (true, name) => {
                    let output = ["-o", usual_output(name)?].map(OsString::from);
                    let words = words.get(at..)?.iter().cloned().chain(output);
                    Some(Mistaken {
                        message: "there is no output: pass it after -o".to_owned(),
                        help: shell::command(words),
                    })
                }
            }
        }
        _ => None,
    }
}

/// The parser's message in plain words, without hints that lead nowhere: how to pass an option as a
/// path, and where to read of an option whose value is out of range.
pub fn words_of(error: &clap::Error) -> String {
    let is_value = matches!(error.kind(), Mistake::InvalidValue | Mistake::ValueValidation);
    let text = error.to_string();
    let kept = text.trim_start_matches("error: ").lines().filter(|line| {
        let is_hint = is_value && line.starts_with("For more information");
        !is_hint && !line.trim_start().starts_with("tip: to pass '")
    });
    let mut words = kept.map(plain_range).collect::<Vec<_>>().join("\n");
    for (found, plain) in PARSING {
        words = words.replace(found, plain);
    }
    while words.contains("\n\n\n") {
        words = words.replace("\n\n\n", "\n\n");
    }
    words.trim_end().to_owned()
}

/// A line such as `...: 0 is not in 1..=1024`, with `expected 1 to 1024`.
fn plain_range(line: &str) -> String {
    let plain = || {
        let (before, range) = line.rsplit_once(" is not in ")?;
        let (from, to) = range.split_once("..=")?;
        let (before, _) = before.rsplit_once(": ")?;
        Some(format!("{before}: expected {from} to {to}"))
    };
    plain().unwrap_or_else(|| line.to_owned())
}

/// The verb of a command line, and its place.
fn verb_of<'a>(
    words: &[OsString],
    program: &'a clap::Command,
) -> Option<(usize, &'a clap::Command)> {
    words
        .iter()
        .enumerate()
        .skip(1)
        .find_map(|(at, word)| program.find_subcommand(word).map(|verb| (at, verb)))
}

/// `mipvog-bake scene.mipvog`.
fn a_file_alone(word: &str) -> Option<Mistaken> {
    let path = Path::new(word);
    let file = SourceFile::open(path);
    if file.is_err() && !path.is_dir() {
        return None;
    }
    let message = format!("{word} is a file, not a verb");
    let help = match file {
        Ok(file) if is_container(&file) || is_asset(&file) => {
            format!("{} shows it", shell::command(["view", word]))
        }
        _ => {
            let output = container_name(path);
            let command = [OsString::from("bake"), word.into(), "-o".into(), output.into()];
            format!("{} bakes it", shell::command(command))
        }
    };
    Some(Mistaken { message, help })
}

/// `mipvog-bake merge a.mipvog b.mipvog`.
fn an_option_alone(word: &str, program: &clap::Command) -> Option<Mistaken> {
    let others = verbs_with(word, program);
    (!others.is_empty()).then(|| Mistaken {
        message: format!("{word} is not a verb"),
        help: format!("--{word} is an option of {}", others.join(", ")),
    })
}

/// The verbs that have an option of this name.
fn verbs_with<'a>(name: &str, program: &'a clap::Command) -> Vec<&'a str> {
    let has =
        |other: &&clap::Command| other.get_arguments().any(|own| own.get_long() == Some(name));
    program.get_subcommands().filter(has).map(clap::Command::get_name).collect()
}

/// A name for the output of a verb other than `bake`.
fn usual_output(verb: &str) -> Option<&'static str> {
    Some(match verb {
        "attach" | "detach" => "out.glb",
        "export" => "scene.html",
        "probe" => "values.safetensors",
        "render" => "pictures/",
        "sweep" => "sweep/",
        "transcode" => "out.mipvog",
        "unpack" => "scene.safetensors",
        _ => return None,
    })
}

/// `mipvog-bake bake in.tar out.mipvog`, or without an output at all.
fn no_output(words: &[OsString]) -> Option<Mistaken> {
    let is_path = |word: &&OsString| !word.to_string_lossy().starts_with('-');
    let paths: Vec<&OsString> = words.iter().take_while(is_path).collect();
    let (input, output) = match *paths {
        [input] => (input, container_name(Path::new(input))),
        [input, output] if !Path::new(output).exists() => (input, PathBuf::from(output)),
        [_, _, ..] => {
            return Some(Mistaken {
                message: "there is no output".to_owned(),
                help: "several inputs go into a folder: -o baked/".to_owned(),
            });
        }
        _ => return None,
    };
    let command = ["bake".as_ref(), input.as_os_str(), "-o".as_ref(), output.as_os_str()];
    Some(Mistaken {
        message: "there is no output: pass it after -o".to_owned(),
        help: shell::command(command),
    })
}

/// True for a word that is a value or a unit, not a path.
fn is_bare(word: &str) -> bool {
    !word.is_empty() && !word.contains(['.', '/', '\\']) && !Path::new(word).exists()
}

/// `mipvog-bake transcode in.mipvog out.mipvog`.
fn a_second_path(word: &str, verb: &clap::Command, words: &[OsString]) -> Option<Mistaken> {
    let has_output = verb.get_arguments().any(|own| own.get_id() == "output");
    let name = verb.get_name();
    let is_named = name == "compare" || words.iter().any(|word| word == "-o" || word == "--output");
    has_output.then(|| match is_named {
        true if is_bare(word) => Mistaken {
            message: format!("unexpected argument '{word}'"),
            help: "separate the values of an option with commas, such as --scales 1,2, and write \
                   units without a space, such as 1.5MB"
                .to_owned(),
        },
        true => Mistaken {
            message: match name {
                "compare" => {
                    format!("'{word}' is a third path: compare takes a reference and a field")
                }
                _ => format!("{name} takes one input, and '{word}' is another"),
            },
            help: "run it once for each, in a loop of the shell".to_owned(),
        },
        false => Mistaken {
            message: format!("unexpected argument '{word}'"),
            help: format!("an output goes after -o: -o {}", shell::quoted(word)),
        },
    })
}

/// `mipvog-bake transcode --quality 50`.
fn an_option_of_others(
    name: &str,
    verb: &clap::Command,
    (at, words): (usize, &[OsString]),
    program: &clap::Command,
) -> Option<Mistaken> {
    let message = format!("{} has no option --{name}", verb.get_name());
    let mut own = verb.get_arguments().filter_map(clap::Arg::get_long);
    if let Some(longer) = own.find(|own| own.starts_with(name)) {
        return Some(Mistaken { message, help: format!("--{longer} may be meant") });
    }
    let others = verbs_with(name, program);
    if others.is_empty() {
        return None;
    }
    let help = match verb.get_name() {
        "transcode" if OF_CONTAINERS.contains(&name) => {
            let rest = words.iter().skip(at + 1).cloned();
            let command = shell::command(std::iter::once(OsString::from("bake")).chain(rest));
            format!("bake takes containers too: {command}")
        }
        _ => format!("--{name} is an option of {}", others.join(", ")),
    };
    Some(Mistaken { message, help })
}

/// The container for an input if only a folder is given.
pub fn container_name(input: &Path) -> PathBuf {
    let stem = input.file_stem().filter(|_| input != Path::new(STANDARD_STREAM));
    named(stem.unwrap_or("scene".as_ref()))
}

fn named(stem: &OsStr) -> PathBuf {
    let mut name = stem.to_owned();
    // Text behind any other dot is part of the stem.
    name.push(".mipvog");
    name.into()
}

/// The containers of several inputs in a folder: named after the files, or after their folders if
/// the files have the same name, like checkpoints.
///
/// # Errors
/// `Usage` for duplicate names.
pub fn container_names(inputs: &[PathBuf], folder: &Path) -> Result<Vec<PathBuf>> {
    let of_files: Vec<PathBuf> = inputs.iter().map(|input| container_name(input)).collect();
    let is_new = |names: &[PathBuf]| {
        let mut sorted: Vec<&PathBuf> = names.iter().collect();
        sorted.sort_unstable();
        sorted.windows(2).all(|two| two[0] != two[1])
    };
    let of_folders = || {
        let folders = inputs.iter().map(|input| input.parent()?.file_name());
        let names = folders.map(|name| name.map(named));
        names.collect::<Option<Vec<PathBuf>>>()
    };
    let names = match is_new(&of_files) {
        true => Some(of_files),
        false => of_folders().filter(|names| is_new(names)),
    };
    let names = names.ok_or_else(|| {
        let message = "two of the inputs have one name, and their folders do too";
        Error::usage(message).advise("bake them one by one, or name outputs in a --manifest")
    })?;
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

/// True if a path names a folder: it ends with a slash.
pub fn is_folder_name(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(std::path::is_separator)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn containers_are_named_by_files_or_else_by_folders() {
        let names = |inputs: &[&str]| {
            let inputs: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
            let names = container_names(&inputs, Path::new("out")).ok()?;
            Some(names.iter().map(|name| name.display().to_string()).collect::<Vec<_>>())
        };
        let found = |expected: &[&str]| Some(expected.iter().map(ToString::to_string).collect());
        assert_eq!(names(&["a.tar", "s/b.npz"]), found(&["out/a.mipvog", "out/b.mipvog"]));
        assert_eq!(names(&["step.10.pt"]), found(&["out/step.10.mipvog"]));
        let checkpoints = ["s/lego/fine_last.tar", "s/chair/fine_last.tar"];
        assert_eq!(names(&checkpoints), found(&["out/lego.mipvog", "out/chair.mipvog"]));
        assert_eq!(names(&["a/x.tar", "b/a/x.tar"]), None);
        assert_eq!(names(&["x.tar", "x.npz"]), None);
    }
}
