//! Mistakes on the command line, and what is told of them: the remedy is what to type.

use std::path::Path;
use std::process::Output;

use crate::common::{fixture, folder, program};

fn run(here: &Path, line: &[&str]) -> Output {
    program().current_dir(here).args(line).output().expect("starts")
}

fn words(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a line that must end with this code, and say each of these on standard error.
fn ends(here: &Path, line: &[&str], code: i32, says: &[&str]) -> Output {
    let output = run(here, line);
    let message = words(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line:?}: {message}");
    for part in says {
        assert!(message.contains(part), "{line:?}: no {part:?} in {message}");
    }
    output
}

/// A container, `a.mipvog`, and its checkpoint, `in.tar`.
fn workplace() -> tempfile::TempDir {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), here.join("a.mipvog")).expect("copied");
    std::fs::copy(fixture("trained/tiny/fine_last.tar"), here.join("in.tar")).expect("copied");
    folder
}

#[test]
fn values_out_of_range_name_their_range_and_nothing_else() {
    let folder = workplace();
    let here = folder.path();
    let bake = ["bake", "in.tar", "-o", "x.mipvog"];
    for (option, value, says) in [
        ("--stepsize", "-1", "--stepsize: found -1"),
        ("--far", "abc", "expected a number"),
        ("--levels", "-3", "expected a whole number"),
        ("--zstd-level", "x", "expected a whole number"),
    ] {
        let output = ends(here, &[&bake[..], &[option, value]].concat(), 2, &[says]);
        let message = words(&output.stderr);
        assert!(
            !message.contains("For more information") && !message.contains("-- -"),
            "{message}"
        );
    }
    let output = ends(here, &["bake", "in.tar", "-o", "x.mipvog", "--log"], 2, &["--log"]);
    assert!(!words(&output.stderr).contains("as a value"));
}

#[test]
fn the_remedy_of_a_path_in_the_wrong_place_can_be_typed() {
    let folder = workplace();
    let here = folder.path();
    std::fs::create_dir(here.join("empty")).expect("made");
    std::fs::write(here.join("scenes.jsonl"), "{\"input\": \"a\", \"output\": \"b\"}\n").expect("");
    std::fs::copy(here.join("in.tar"), here.join("two.tar")).expect("copied");
    std::fs::write(here.join("notes.txt"), "nothing to bake\n").expect("written");
    let cases: [(&[&str], i32, &[&str]); 13] = [
        (&["bake", "in.tar", "two.tar"], 2, &["several inputs go into a folder: -o baked/"]),
        (&["render", "a.mipvog", "b.mipvog", "-o", "p/"], 2, &["render takes one input"]),
        (&["compare", "in.tar", "a.mipvog", "b.mipvog"], 2, &["'b.mipvog' is a third path"]),
        (&["compare", "in.tar", "a.mipvog", "-o", "x.png"], 2, &["name a folder", "page.html"]),
        (&["export", "a.mipvog", "-o", "a.obj"], 2, &["write a mesh as .glb"]),
        (&["export", "a.mipvog", "--to", "obj", "-o", "a.obj"], 2, &["write a mesh as .glb"]),
        (&["report", "r.jsonl", "--to", "junit"], 2, &["--junit FILE.xml"]),
        (&["report", "r.jsonl", "-o", "out.xml"], 2, &["--junit FILE.xml"]),
        (&["report", "a.mipvog"], 3, &["found a .mipvog container", "lines of JSON"]),
        (&["bake", "scenes.jsonl", "-o", "x.mipvog"], 3, &["bake --manifest"]),
        (&["bake", "in.tar", "-o", "x.mipvog", "--cameras", "empty"], 5, &["transforms.json"]),
        (&["inspect", "notes.txt"], 3, &["expected a .mipvog container, a glTF asset with one, "]),
        (&["inspect", "a.mipvog", "--thumbnail", "t.jpg"], 2, &["a thumbnail is a PNG", "t.png"]),
    ];
    for (line, code, says) in cases {
        ends(here, line, code, says);
    }
    let left = std::fs::read_dir(here).expect("a folder").count();
    assert_eq!(left, 6, "nothing is written");
}

#[test]
fn a_forecast_needs_no_output() {
    let folder = workplace();
    let here = folder.path();
    let output = ends(here, &["bake", "in.tar", "--dry-run"], 0, &[]);
    assert!(words(&output.stdout).starts_with("in.mipvog: about "), "{}", words(&output.stdout));
    ends(here, &["bake", "in.tar"], 2, &["there is no output"]);
}

#[test]
fn the_options_of_a_preset_bake_the_same_when_they_are_typed() {
    let folder = workplace();
    let here = folder.path();
    for preset in ["faithful", "web", "archive"] {
        let bake = ["bake", "in.tar", "--force", "-o"];
        let output =
            ends(here, &[&bake[..], &["p.mipvog", "--preset", preset]].concat(), 0, &["preset "]);
        let message = words(&output.stderr).replace("\n   ", "");
        let start = format!("preset {preset}: ");
        let told = message.lines().find_map(|line| line.strip_prefix(&start));
        let options: Vec<&str> = told.expect("its options").split(' ').collect();
        ends(here, &[&bake[..], &["t.mipvog"], &options].concat(), 0, &[]);
        let [stands_for, typed] =
            ["p.mipvog", "t.mipvog"].map(|name| std::fs::read(here.join(name)).expect("baked"));
        assert!(stands_for == typed, "{preset}: {told:?}");
    }
}

#[test]
fn files_beside_a_checkpoint_count_for_inspect_and_validate() {
    let folder = workplace();
    let here = folder.path();
    let noted = ends(here, &["inspect", "in.tar"], 0, &[]);
    assert!(words(&noted.stdout).contains("step length"));
    assert!(words(&noted.stdout).contains("near and far are not stored"));
    ends(here, &["validate", "in.tar", "--deny-warnings"], 1, &["warning", "--deny-warnings"]);
    std::fs::write(here.join("scene.toml"), "stepsize = 0.25\n").expect("written");
    let noted = words(&ends(here, &["inspect", "in.tar"], 0, &[]).stdout);
    assert!(!noted.contains("step length") && noted.contains("scene.toml has stepsize"), "{noted}");
}
