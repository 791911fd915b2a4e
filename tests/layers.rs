//! A module uses rows above its own, never its own row or one below: the order of ARCHITECTURE.md.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The rows of the page, top first.
fn rows() -> BTreeMap<String, usize> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md");
    let page = std::fs::read_to_string(page).expect("ARCHITECTURE.md");
    let start = page.find("```text\n0 ").expect("the table of rows starts at row 0");
    let table = page[start + 8..].split("```").next().expect("it ends");
    let mut rows = BTreeMap::new();
    for line in table.lines().filter(|line| !line.trim().is_empty()) {
        let mut words = line.split_whitespace();
        let row: usize = words.next().expect("a number").parse().expect("a row's number");
        words.for_each(|module| {
            assert!(rows.insert(module.to_owned(), row).is_none(), "{module} twice")
        });
    }
    rows
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The modules of the crate that a source names as `crate::module`, alone or in braces.
fn used(text: &str) -> Vec<String> {
    let mut modules = Vec::new();
    for (at, found) in text.match_indices("crate::") {
        let rest = &text[at + found.len()..];
        let line = text[..at].rsplit('\n').next().unwrap_or_default();
        let is_docs = line.trim_start().starts_with("//");
        let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        if !name.is_empty() && !is_docs {
            modules.push(name);
        }
    }
    modules
}

#[test]
fn modules_use_only_rows_above_their_own() {
    let rows = rows();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    assert!(files.len() > 40);
    for file in files {
        let relative = file.strip_prefix(&root).expect("inside src");
        let module = relative.components().next().expect("a name").as_os_str().to_string_lossy();
        let module = module.trim_end_matches(".rs");
        if module == "lib" || module == "main" {
            continue;
        }
        let own = *rows.get(module).unwrap_or_else(|| panic!("{module} is in no row of the page"));
        for other in used(&std::fs::read_to_string(&file).expect("text")) {
            // A macro or an item of the crate's root is no module.
            let Some(&row) = rows.get(&other) else { panic!("{file:?} uses {other}, in no row") };
            assert!(other == module || row < own, "{file:?} (row {own}) uses {other} (row {row})");
        }
    }
}

/// Folders whose numbers are stored, or decide what is.
const STORED: [&str; 7] = ["bake", "codec", "input", "levels", "model", "output", "view"];
/// Functions of std whose last bits differ from machine to machine; `libm` has the same everywhere.
const INEXACT: [&str; 16] = [
    "exp", "exp2", "exp_m1", "ln", "ln_1p", "log2", "log10", "powf", "cbrt", "sin", "cos",
    "sin_cos", "tan", "tanh", "atan2", "mul_add",
];

#[test]
fn what_is_stored_is_computed_the_same_on_every_machine() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut held = 0;
    for file in files {
        let relative = file.strip_prefix(&root).expect("inside src").to_string_lossy().into_owned();
        let module = relative.split(['/', '.']).next().expect("a name");
        if !STORED.contains(&module) {
            continue;
        }
        let text = std::fs::read_to_string(&file).expect("text");
        // Unit tests come last, and compare with std.
        let code = text.split("#[cfg(test)]\nmod tests").next().expect("code");
        for name in INEXACT {
            assert!(!code.contains(&format!(".{name}(")), "{relative} calls {name} of std");
        }
        held += 1;
    }
    assert!(held > 60, "only {held} files");
}
