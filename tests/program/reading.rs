//! What people read: help in a minute, reports as wide as the terminal.

use std::path::Path;

use crate::common::{folder, program};
use crate::verbs::{scene, stderr};

/// Words that a minute is enough for.
const SHORT: usize = 250;
/// Columns of help and of reports.
const WIDEST: usize = 100;

fn printed(here: &Path, columns: usize, arguments: &[&str]) -> String {
    let mut command = program();
    command.current_dir(here).args(arguments).env("COLUMNS", columns.to_string());
    let output = command.output().expect("starts");
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    String::from_utf8(output.stdout).expect("text")
}

fn assert_narrow(text: &str, columns: usize, of: &str) {
    for line in text.lines() {
        // A command is pasted as it stands.
        let is_command = line.contains("mipvog-bake ") && !line.contains("`mipvog-bake");
        let length = line.chars().count();
        assert!(is_command || length <= columns, "{of}: {length} columns: {line}");
    }
}

fn verbs() -> Vec<String> {
    let help = printed(Path::new("."), WIDEST, &["--help"]);
    let listed = help.split("Commands:").nth(1).and_then(|rest| rest.split("Options:").next());
    let lines = listed.expect("commands").lines();
    let lines = lines.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    lines.filter_map(|line| line.split_whitespace().next().map(str::to_owned)).collect()
}

#[test]
fn the_short_help_of_every_verb_is_read_in_a_minute() {
    let here = Path::new(".");
    let verbs = verbs();
    assert!(verbs.len() > 15, "{verbs:?}");
    for verb in verbs.iter().filter(|verb| *verb != "help") {
        let short = printed(here, WIDEST, &[verb, "-h"]);
        let words = short.split_whitespace().count();
        assert!(words <= SHORT, "{verb} -h: {words} words");
        assert_narrow(&short, WIDEST, &format!("{verb} -h"));
        let long = printed(here, WIDEST, &[verb, "--help"]);
        assert_narrow(&long, WIDEST, &format!("{verb} --help"));
        // Options of `-h` are among those of `--help`, which has more.
        let options = |text: &str| -> Vec<String> {
            let lines = text.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
            let options =
                lines.filter_map(|line| line.split([' ', ',']).find(|w| w.starts_with("--")));
            options.map(str::to_owned).collect()
        };
        let whole = options(&long);
        assert!(options(&short).iter().all(|option| whole.contains(option)), "{verb}");
    }
    let program = printed(here, WIDEST, &["-h"]);
    assert!(program.split_whitespace().count() <= SHORT, "{program}");
}

#[test]
fn shared_options_are_explained_once_and_named_elsewhere() {
    let here = Path::new(".");
    for verb in ["render", "compare", "export", "probe", "sweep"] {
        let help = printed(here, WIDEST, &[verb, "--help"]);
        assert!(
            help.contains("Scene options, which `mipvog-bake bake --help` explains:"),
            "{help}"
        );
        assert!(help.contains("General options, which `mipvog-bake --help` explains:"), "{help}");
        assert!(help.contains("--background"), "{help}");
        assert!(!help.contains("Colour behind the field"), "{help}");
    }
    let bake = printed(here, WIDEST, &["bake", "--help"]);
    assert!(bake.contains("Colour behind the field"), "{bake}");
    assert!(!bake.contains("which `mipvog-bake bake --help`"), "{bake}");
}

#[test]
fn reports_fit_the_terminal_and_break_no_number() {
    let folder = folder();
    let here = folder.path();
    let scene = scene();
    std::fs::copy(&scene, here.join("scene.tar")).expect("copied");
    let bake = ["bake", "scene.tar", "--stepsize", "0.5", "--force", "-o", "a.mipvog"];
    let verbose = [&bake[..], &["-v", "--preset", "web"]].concat();
    let view = ["--size", "40", "--scales", "1,2"];
    let compare = [&["compare", "scene.tar", "a.mipvog", "--stepsize", "0.5"], &view[..]].concat();
    let dry = [&bake[..], &["--dry-run"]].concat();
    let sweep =
        ["sweep", "scene.tar", "--stepsize", "0.5", "--bits", "6,8", "--filter", "rate-tent"];
    let sweep = [&sweep[..], &view, &["--repeat", "1", "--turntable", "1", "-o", "s"]].concat();
    // Keys of checkpoints, which -v lists, are as long as they are.
    let inspect = ["inspect", "a.mipvog", "scene.tar"];
    let levels = ["inspect", "a.mipvog", "-v"];
    let render =
        ["render", "a.mipvog", "--turntable", "2", "--size", "8", "--force", "-o", "p", "-v"];
    let validate = ["validate", "a.mipvog", "scene.tar"];
    let export = ["export", "a.mipvog", "-o", "a.glb", "--triangles", "100", "--force"];
    let lines: [&[&str]; 10] =
        [&bake, &verbose, &compare, &dry, &sweep, &inspect, &levels, &render, &validate, &export];
    for columns in [100, 80, 60] {
        for line in lines {
            let text = printed(here, columns, line);
            assert_narrow(&text, columns, &line.join(" "));
            for row in text.lines() {
                let first = row.split_whitespace().next().unwrap_or_default();
                let unit = first.trim_end_matches([',', ';', ')', '.']);
                let units = ["B", "kB", "MB", "GB", "s", "dB", "x", "%"];
                assert!(!units.contains(&unit), "a number without its unit: {text}");
            }
        }
    }
}

#[test]
fn a_bake_says_what_matters_in_a_few_lines() {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(scene(), here.join("my scene.tar")).expect("copied");
    let text = printed(here, 100, &["bake", "my scene.tar", "-o", "it's.mipvog", "--near", "2"]);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines.len() <= 6, "{text}");
    assert!(lines[0].starts_with("it's.mipvog: "), "{text}");
    assert!(lines[0].contains(" x smaller than my scene.tar ("), "{text}");
    assert!(
        lines[1].contains("first, coarse picture after ") && lines[1].contains("voxels kept"),
        "{text}"
    );
    assert!(text.contains("near 2 (command line)"), "{text}");
    assert!(text.contains("color-threshold "), "{text}");
    // The next command can be pasted: the program's own path, and quotes.
    let next = lines[lines.len() - 1].trim_start();
    let next = next.strip_prefix("next: ").expect("a next command");
    assert!(next.ends_with(r"view 'it'\''s.mipvog'"), "{next}");
    assert!(next.starts_with(crate::common::PROGRAM), "{next}");
    // The table of levels is for those who ask.
    assert!(!text.contains("prefix"), "{text}");
    let verbose = ["bake", "my scene.tar", "-o", "b.mipvog", "-v"];
    assert!(printed(here, 100, &verbose).contains("prefix"));
}
