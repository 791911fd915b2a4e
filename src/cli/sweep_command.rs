//! The command that bakes a setting of a sweep alone.

use std::ffi::{OsStr, OsString};

use clap::{Arg, Args, Command};

use super::cameras::CameraArguments;
use super::scene::SceneArguments;
use super::shell;
use crate::sweep::Setting;

/// The command for a setting, from the sweep's own command line: the input, the options of the
/// scene, those of cameras if the bake uses them, and the setting's own.
pub fn bake_command(input: &OsStr, setting: &Setting) -> Option<String> {
    let typed = shell::typed()?;
    let mut words: Vec<OsString> = vec!["bake".into(), input.to_owned()];
    words.extend(kept::<SceneArguments>(typed));
    if setting.options.sees() {
        words.extend(kept::<CameraArguments>(typed));
    }
    words.extend(setting.words.iter().flatten().map(OsString::from));
    words.extend(["-o".into(), format!("{}.mipvog", setting.name).into()]);
    Some(shell::command(words))
}

/// The options of `A` in a command line, with their values.
fn kept<A: Args>(typed: &[OsString]) -> Vec<OsString> {
    let own = A::augment_args(Command::new("bake"));
    let find = |word: &OsStr| {
        let word = word.to_str()?.strip_prefix("--")?;
        let (name, has_value) =
            word.split_once('=').map_or((word, false), |(name, _)| (name, true));
        let is_named = |argument: &&Arg| argument.get_long() == Some(name);
        let argument = own.get_arguments().find(is_named)?;
        Some(argument.get_action().takes_values() && !has_value)
    };
    let mut words = typed.iter();
    let mut found = Vec::new();
    while let Some(word) = words.next() {
        if let Some(takes_value) = find(word) {
            found.push(word.clone());
            if takes_value {
                found.extend(words.next().cloned());
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_the_scene_stay() {
        let typed = [
            "sweep",
            "a.tar",
            "--stepsize",
            "0.5",
            "--bits",
            "6,8",
            "--near=2",
            "--drop-background",
            "--size",
            "40",
            "-o",
            "sweep/",
            "--far",
            "6",
        ];
        let typed = typed.map(OsString::from);
        let scene = ["--stepsize", "0.5", "--near=2", "--drop-background", "--far", "6"];
        assert_eq!(kept::<SceneArguments>(&typed), scene);
        assert_eq!(kept::<CameraArguments>(&typed), ["--size", "40"]);
    }
}
