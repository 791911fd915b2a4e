//! The commands of `README.md` and of the manual, `docs/`, run.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use crate::common::pages::{manual, sections, text};
use crate::common::{PROGRAM, fixture, folder};

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
        std::fs::copy(fixture(from), to).expect("copied");
    };
    copy("trained/lego64/fine_last.tar", "fine_last.tar");
    copy("trained/lego64/coarse_last.tar", "coarse_last.tar");
    copy("trained/lego64/transforms_test.json", "transforms.json");
    copy("trained/tiny/fine_last.tar", "scenes/chair/fine_last.tar");
    copy("trained/tiny/fine_last.tar", "scenes/lamp/fine_last.tar");
    copy("voxels/svraster_unbounded.pt", "garden.pt");
    copy("voxels/svraster_unbounded.config.yaml", "garden.config.yaml");
    folder
}

fn has(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

#[test]
fn every_command_of_the_manual_runs() {
    let (folder, of_readme) = (workplace(), workplace());
    let own = Path::new(PROGRAM).parent().expect("a folder").display().to_string();
    let path = format!("{own}:{}", std::env::var("PATH").expect("a search path"));
    let (mut ran, mut set_up) = (BTreeSet::new(), Vec::new());
    let readme = Path::new("README.md");
    let pages = [vec![(readme.to_owned(), text(readme))], manual()].concat();
    let blocks = pages.iter().flat_map(|(page, text)| {
        blocks(text).into_iter().map(move |(fence, lines)| (page, fence, lines))
    });
    for (page, fence, lines) in blocks {
        // The book goes on where its last page ended; the README stands alone.
        let folder = if page == readme { of_readme.path() } else { folder.path() };
        let (language, more) = fence.split_once(' ').unwrap_or((fence, ""));
        // Lines of Rust are those of a crate's page, which is compiled.
        if ["text", "rust"].contains(&language) {
            continue;
        }
        if language != "sh" {
            // A file under the name behind its language.
            assert!(!more.is_empty(), "a block of {language} without a name");
            std::fs::write(folder.join(more), format!("{lines}\n")).expect("writable");
            continue;
        }
        if more == "set-up" {
            set_up.push((page, lines));
            continue;
        }
        if let Some(program) = more.strip_prefix("needs=").filter(|program| !has(program)) {
            eprintln!("note: no {program} here; its commands were not run");
            continue;
        }
        let mut command = Command::new("sh");
        command.args(["-euc", lines]).current_dir(folder).env("PATH", &path);
        let output = command.output().expect("a shell");
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {lines}\n{message}", page.display());
        let words = lines.split_whitespace().collect::<Vec<_>>();
        ran.extend(words.windows(2).filter(|two| two[0] == "mipvog-bake").map(|two| two[1]));
    }
    // A machine is set up by two commands: one bakes the fixture scene, one runs the tests.
    assert!(set_up.iter().all(|(page, lines)| *page == readme && lines.lines().count() == 1));
    let starts: Vec<&str> = set_up.iter().map(|(_, lines)| &lines[..10]).collect();
    assert_eq!(starts, ["cargo run ", "cargo test"]);
    for verb in sections().into_keys().filter(|name| name.starts_with('`')) {
        assert!(ran.contains(verb.trim_matches('`')), "no command of {verb} in the manual");
    }
    // Files that are held to a schema elsewhere exist, and outputs that failed on purpose do not.
    for name in ["scene.sarif", "cut.sarif", "health.json", "out/chair.mipvog", "sweep/sweep.html"]
    {
        assert!(folder.path().join(name).is_file(), "no {name}");
    }
}
