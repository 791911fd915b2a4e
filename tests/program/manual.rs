//! The manual, `docs/`: its options are those of `--help`. The lines of Rust in `README.md` are those
//! of the crate's page, which is compiled.

use std::collections::BTreeSet;

use crate::common::pages::sections;
use crate::common::program;

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
            .flat_map(|line| {
                let words = line.split([' ', ',']).filter(|word| word.starts_with("--"));
                // A line of names, or that of one option.
                let count =
                    if line.starts_with("--") && line.contains(", --") { usize::MAX } else { 1 };
                words.take(count)
            })
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
    let crate_docs = include_str!("../../crates/mipvog/src/lib.rs");
    let mut stated = crate_docs.lines().filter_map(|line| line.strip_prefix("//! "));
    for line in lines.filter(|line| !line.is_empty()) {
        assert!(stated.any(|other| other == line), "the crate's page should go on with {line}");
    }
}
