//! The manual, `docs/`: its commands run, and its options are those of `--help`. The lines of Rust
//! in `README.md` are those of the crate's page, which is compiled.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{fixture, folder, pages, program};

const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");

/// The pages of the manual, in the order of the book.
fn manual() -> Vec<(PathBuf, String)> {
    let pages = pages::listed().into_iter().filter(|page| page.starts_with("docs"));
    let pages = pages.filter(|page| !page.starts_with("docs/pictures"));
    pages.map(|page| (page.clone(), pages::text(&page))).collect()
}

/// Fenced blocks: the words behind the fence, and the lines within.
fn blocks(page: &str) -> Vec<(&str, &str)> {
    let mut parts = page.split("\n```");
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
    let pages = manual();
    let blocks = pages.iter().flat_map(|(page, text)| {
        blocks(text).into_iter().map(move |(fence, lines)| (page, fence, lines))
    });
    for (page, fence, lines) in blocks {
        let (language, more) = fence.split_once(' ').unwrap_or((fence, ""));
        if language == "text" {
            continue;
        }
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
        assert!(output.status.success(), "{}: {lines}\n{message}", page.display());
        let words = lines.split_whitespace().collect::<Vec<_>>();
        ran.extend(words.windows(2).filter(|two| two[0] == "mipvog-bake").map(|two| two[1]));
    }
    for verb in sections().into_keys().filter(|name| name.starts_with('`')) {
        assert!(ran.contains(verb.trim_matches('`')), "no command of {verb} in the manual");
    }
    // Files that are held to a schema elsewhere exist, and outputs that failed on purpose do not.
    for name in ["scene.sarif", "cut.sarif", "health.json", "out/chair.mipvog", "sweep/sweep.html"]
    {
        assert!(folder.path().join(name).is_file(), "no {name}");
    }
}

/// Under each heading of the rules and of the pages of verbs: long options in the first cells of its
/// tables, and headings of the rules that the text links to. Names of verbs are in backquotes.
fn sections() -> BTreeMap<String, (BTreeSet<String>, Vec<String>)> {
    let mut sections = BTreeMap::new();
    let is_of_verbs = |page: &Path| page.starts_with("docs/verbs");
    let pages = manual().into_iter();
    let pages = pages.filter(|(page, _)| is_of_verbs(page) || page.ends_with("manual.md"));
    for (_, text) in pages {
        // Only headings that are the name of a verb, or stand in the rules, begin a section.
        for section in format!("\n{text}").split("\n#").skip(1) {
            let (head, text) = section.split_once('\n').expect("text");
            let cells =
                text.lines().filter_map(|line| line.strip_prefix("| `-")?.split(" | ").next());
            let options = cells.filter_map(|cell| cell.split('`').next());
            let options = options.map(|option| format!("-{option}"));
            let links = text.split("manual.md#").skip(1).filter_map(|link| link.split(')').next());
            let found = (options.collect(), links.map(str::to_owned).collect());
            sections.insert(head.trim_start_matches('#').trim().to_owned(), found);
        }
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
    let sections = sections();
    let described = sections.keys().filter_map(|head| head.strip_prefix('`')?.strip_suffix('`'));
    assert_eq!(listed, described.map(str::to_owned).collect());
    for verb in listed {
        let text = help(&[&verb, "--help"]);
        let options: BTreeSet<String> = text
            .lines()
            .map(str::trim_start)
            .filter(|line| line.starts_with('-'))
            .filter_map(|line| line.split([' ', ',']).find(|word| word.starts_with("--")))
            .map(str::to_owned)
            .collect();
        let (own, links) = &sections[&format!("`{verb}`")];
        let mut told = own.clone();
        for head in links.iter().map(String::as_str).chain(["all-verbs"]) {
            let shared =
                sections.iter().find(|(name, _)| name.to_lowercase().replace(' ', "-") == head);
            told.extend(shared.unwrap_or_else(|| panic!("no section {head}")).1.0.clone());
        }
        assert_eq!(told, options, "{verb}");
    }
}

#[test]
fn the_lines_of_rust_in_the_readme_are_those_of_the_crate_docs() {
    let readme = include_str!("../../README.md");
    let block = readme.split("```rust\n").nth(1).expect("a block of Rust");
    let lines = block.split("```").next().expect("it ends").lines();
    let crate_docs = include_str!("../../src/lib.rs");
    let mut stated = crate_docs.lines().filter_map(|line| line.strip_prefix("//! "));
    for line in lines.filter(|line| !line.is_empty()) {
        assert!(stated.any(|other| other == line), "the crate's page should go on with {line}");
    }
}
