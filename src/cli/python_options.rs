//! The options of `bake` for Python editors and batches: a module of `python/mipvog_bake`,
//! generated from the parser.

use std::any::TypeId;
use std::path::PathBuf;

use clap::{Arg, ArgAction, CommandFactory as _};
use mipvog_inputs::MlpChoice;

use super::manifest::OF_ALL;
use super::output::OUTPUTS;
use super::program::Cli;

/// Options that do not apply to a call of `bake`, or are arguments of the call.
const NONE_OF: [&str; 8] =
    ["help", "version", "format", "quiet", "verbose", "color", "progress", "dry-run"];
const HEAD: &str = r#""""The options of `bake`. They follow from the program's parser:
`BLESS=1 cargo test the_options_of_python` renews this file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Optional, TypedDict, Union

# What the program reads as text: one value, or several.
Words = Union[str, int, float, Sequence[Any], Mapping[str, Any]]
PathName = Union[str, os.PathLike[str]]
PathNames = Union[PathName, Sequence[PathName]]


class BakeOptions(TypedDict, total=False):
    """Options of `bake`. One that is None or False is not given."""
"#;

/// The text of `python/mipvog_bake/_bake_options.py`.
pub fn python_options() -> String {
    let program = Cli::command();
    let bake = program.find_subcommand("bake").into_iter().flat_map(clap::Command::get_arguments);
    let options = bake.chain(program.get_arguments());
    let mut options: Vec<(&str, &Arg)> = options
        .filter_map(|argument| Some((argument.get_long()?, argument)))
        .filter(|(name, _)| !NONE_OF.contains(name) && !OF_ALL.contains(name))
        .collect();
    options.sort_unstable_by_key(|(name, _)| *name);
    let mut text = HEAD.to_owned();
    for (name, argument) in &options {
        let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
        let mut words = help.split_whitespace().peekable();
        text += &format!("\n    {}: Optional[{}]\n", name.replace('-', "_"), kind(argument));
        let mut line = "    \"\"\"".to_owned();
        while let Some(word) = words.next() {
            let space = if line.ends_with(['"', ' ']) { "" } else { " " };
            // The last word has a full stop and quotes behind it.
            let end = if words.peek().is_none() { 4 } else { 0 };
            if line.chars().count() + space.len() + word.chars().count() + end > 100 {
                text += &format!("{line}\n");
                line = format!("    {word}");
            } else {
                line += &format!("{space}{word}");
            }
        }
        let stop = if line.ends_with(['.', ']']) { "" } else { "." };
        text += &format!("{line}{stop}\"\"\"\n");
    }
    let listed = |is: &dyn Fn(&Arg) -> bool| {
        let names = options.iter().filter(|(_, argument)| is(argument));
        let names = names.map(|(name, _)| format!("\"{}\"", name.replace('-', "_")));
        names.collect::<Vec<_>>().join(", ")
    };
    let is_output = |argument: &Arg| OUTPUTS.contains(&argument.get_id().as_str());
    let is_path = |argument: &Arg| ["PathName", "PathNames"].contains(&kind(argument));
    let is_input = |argument: &Arg| is_path(argument) && !is_output(argument);
    text += &format!("\n\n# Options that name files to read.\nINPUTS = ({})\n", listed(&is_input));
    text += &format!("# Options that name files to write.\nOUTPUTS = ({})\n", listed(&is_output));
    text
}

/// The type of an option's value.
fn kind(argument: &Arg) -> &'static str {
    if !argument.get_action().takes_values() {
        return "bool";
    }
    let several = argument.get_value_delimiter().is_some();
    let own = argument.get_value_parser().type_id();
    let is = |types: &[TypeId]| types.iter().any(|of| own == *of);
    let whole = [TypeId::of::<u16>(), TypeId::of::<u32>(), TypeId::of::<u64>()];
    let whole = [&whole[..], &[TypeId::of::<usize>(), TypeId::of::<i32>()]].concat();
    let is_append = matches!(argument.get_action(), ArgAction::Append);
    match () {
        () if is(&[TypeId::of::<PathBuf>()]) && is_append => "PathNames",
        () if is(&[TypeId::of::<PathBuf>(), TypeId::of::<MlpChoice>()]) => "PathName",
        () if several || is_append => "Words",
        () if is(&whole) => "int",
        () if is(&[TypeId::of::<f32>(), TypeId::of::<f64>()]) => "float",
        () => "Words",
    }
}
