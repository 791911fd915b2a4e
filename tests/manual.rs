//! `docs/manual.md`: its commands run, and its options are those of `--help`. The lines of Rust in
//! `README.md` are those of the crate's page, which is compiled.

#![cfg(all(feature = "cli", unix))]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use common::{fixture, folder, program};

const MANUAL: &str = include_str!("../docs/manual.md");
const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");

/// Fenced blocks: the words behind the fence, and the lines within.
fn blocks() -> Vec<(&'static str, &'static str)> {
    let mut parts = MANUAL.split("\n```");
    parts.next();
    let mut blocks = Vec::new();
    while let (Some(block), Some(_)) = (parts.next(), parts.next()) {
        blocks.push(block.split_once('\n').expect("a fence ends its line"));
    }
    blocks
}

/// A folder with the files that the page names.
fn workplace() -> tempfile::TempDir {
    let folder = folder();
    let copy = |from: &str, to: &str| {
        let to = folder.path().join(to);
        std::fs::create_dir_all(to.parent().expect("a folder")).expect("writable");
        std::fs::copy(fixture("trained").join(from), to).expect("copied");
    };
    copy("lego64/fine_last.tar", "fine_last.tar");
    copy("lego64/coarse_last.tar", "coarse_last.tar");
    copy("lego64/transforms_test.json", "transforms.json");
    copy("tiny/fine_last.tar", "scenes/chair/fine_last.tar");
    copy("tiny/fine_last.tar", "scenes/lamp/fine_last.tar");
    folder
}

fn has(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

#[test]
fn every_command_of_the_manual_runs() {
    let folder = workplace();
    let own = Path::new(PROGRAM).parent().expect("a folder").display().to_string();
    let path = format!("{own}:{}", std::env::var("PATH").expect("a search path"));
    let mut ran = BTreeSet::new();
    for (fence, lines) in blocks() {
        let (language, more) = fence.split_once(' ').unwrap_or((fence, ""));
        if language != "sh" {
            // A file under the name behind its language.
            assert!(!more.is_empty(), "a block of {language} without a name");
            std::fs::write(folder.path().join(more), format!("{lines}\n")).expect("writable");
            continue;
        }
        if let Some(program) = more.strip_prefix("needs=").filter(|program| !has(program)) {
            eprintln!("note: no {program} here; its commands were not run");
            continue;
        }
        let mut command = Command::new("sh");
        command.args(["-euc", lines]).current_dir(folder.path()).env("PATH", &path);
        let output = command.output().expect("a shell");
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{lines}\n{message}");
        let words = lines.split_whitespace().collect::<Vec<_>>();
        ran.extend(words.windows(2).filter(|two| two[0] == "mipvog-bake").map(|two| two[1]));
    }
    let verbs: BTreeSet<&str> = verbs().into_iter().collect();
    assert_eq!(ran, verbs, "verbs with a command in the manual");
    // Files that are held to a schema elsewhere exist, and outputs that failed on purpose do not.
    for name in ["scene.sarif", "cut.sarif", "health.json", "out/chair.mipvog", "sweep/sweep.html"]
    {
        assert!(folder.path().join(name).is_file(), "no {name}");
    }
}

fn verbs() -> Vec<&'static str> {
    let heads = MANUAL.lines().filter_map(|line| line.strip_prefix("### `"));
    heads.map(|head| head.trim_end_matches('`')).collect()
}

/// Long options in the first cells of the tables under each heading of the chapter of options, and
/// other headings that the text links to.
fn sections() -> BTreeMap<&'static str, (BTreeSet<&'static str>, Vec<&'static str>)> {
    let chapter = MANUAL.split("\n## Options\n").nth(1).expect("the chapter of options");
    let mut sections = BTreeMap::new();
    for section in chapter.split("\n### ").skip(1) {
        let (head, text) = section.split_once('\n').expect("text");
        let cells = text.lines().filter_map(|line| line.strip_prefix("| `")?.split(" | ").next());
        let options = cells.filter_map(|cell| cell.split('`').next());
        let links = text.split("](#").skip(1).filter_map(|link| link.split(')').next());
        let found = (options.collect(), links.collect());
        sections.insert(head.trim_matches('`'), found);
    }
    sections
}

#[test]
fn the_manual_has_every_option_and_no_other() {
    let help = |arguments: &[&str]| {
        let output = program().args(arguments).output().expect("starts");
        assert!(output.status.success(), "{arguments:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let summary = help(&["--help"]);
    let listed = summary.split("Commands:").nth(1).and_then(|rest| rest.split("Options:").next());
    let listed: BTreeSet<String> = listed
        .expect("commands")
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next().map(str::to_owned))
        .filter(|verb| verb != "help")
        .collect();
    assert_eq!(listed, verbs().into_iter().map(str::to_owned).collect());
    let sections = sections();
    for verb in listed {
        let text = help(&[&verb, "--help"]);
        let options: BTreeSet<&str> = text
            .lines()
            .map(str::trim_start)
            .filter(|line| line.starts_with('-'))
            .filter_map(|line| line.split([' ', ',']).find(|word| word.starts_with("--")))
            .collect();
        let (own, links) = &sections[verb.as_str()];
        let mut told = own.clone();
        for head in links.iter().chain(&["all verbs"]) {
            let shared = sections.iter().find(|(name, _)| name.to_lowercase() == *head);
            told.extend(&shared.unwrap_or_else(|| panic!("no section {head}")).1.0);
        }
        assert_eq!(told, options, "{verb}");
    }
}

#[test]
fn the_lines_of_rust_in_the_readme_are_those_of_the_crate_docs() {
    let readme = include_str!("../README.md");
    let block = readme.split("```rust\n").nth(1).expect("a block of Rust");
    let lines = block.split("```").next().expect("it ends").lines();
    let crate_docs = include_str!("../src/lib.rs");
    let mut stated = crate_docs.lines().filter_map(|line| line.strip_prefix("//! "));
    for line in lines.filter(|line| !line.is_empty()) {
        assert!(stated.any(|other| other == line), "the crate's page should go on with {line}");
    }
}
