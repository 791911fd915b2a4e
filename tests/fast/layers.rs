//! Modules of a crate use those before them, in the order of ARCHITECTURE.md; files use each other in
//! no circle. Cargo holds the order of the crates.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The sources of the crates and of the program.
fn roots() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = std::fs::read_dir(root.join("crates")).expect("crates").flatten();
    let crates = crates.map(|entry| entry.path().join("src"));
    crates.chain([root.join("src")]).collect()
}

/// The modules of a crate that the page orders, each with its place.
fn ordered() -> BTreeMap<String, BTreeMap<String, usize>> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md");
    let page = std::fs::read_to_string(page).expect("ARCHITECTURE.md");
    let start = page.find("```text\nformat: ").expect("the table starts with the crate format");
    let table = page[start + 8..].split("```").next().expect("it ends");
    let line = |line: &str| {
        let (name, modules) = line.split_once(": ").expect("a crate and its modules");
        let modules = modules.split_whitespace().map(str::to_owned);
        (name.to_owned(), modules.enumerate().map(|(place, module)| (module, place)).collect())
    };
    table.lines().map(line).collect()
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
fn modules_use_only_those_before_them() {
    let mut held = 0;
    for (name, places) in ordered() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates").join(&name).join("src");
        let mut files = Vec::new();
        sources(&root, &mut files);
        for file in files {
            let relative = file.strip_prefix(&root).expect("inside src");
            let module = relative.components().next().expect("a name").as_os_str();
            let module = module.to_string_lossy();
            let module = module.trim_end_matches(".rs");
            if module == "lib" {
                continue;
            }
            let own = places.get(module);
            let own = *own.unwrap_or_else(|| panic!("{name}: the page does not place {module}"));
            for other in used(&std::fs::read_to_string(&file).expect("text")) {
                // What another crate has, Cargo orders.
                let Some(&place) = places.get(&other) else { continue };
                assert!(place <= own, "{file:?} of {module} uses {other}, which comes later");
                held += 1;
            }
        }
    }
    assert!(held > 500, "only {held} uses were found");
}

/// The path of each module: `["levels", "filter"]` is `levels/filter.rs`.
fn module_path(root: &Path, file: &Path) -> Vec<String> {
    let relative = file.strip_prefix(root).expect("inside src").with_extension("");
    let names = relative.components().map(|name| name.as_os_str().to_string_lossy().into_owned());
    names.filter(|name| name != "mod").collect()
}

/// The paths that a source takes with `use`, with `super` and `crate` resolved and groups spread.
fn used_paths(own: &[String], is_folder: bool, text: &str) -> Vec<Vec<String>> {
    let mut paths = Vec::new();
    let code = text.split("#[cfg(test)]\nmod tests").next().expect("code");
    for statement in code.split(";\n").filter_map(|part| part.split("use ").nth(1)) {
        let flat: String = statement.chars().filter(|c| !c.is_whitespace()).collect();
        spread(&flat, &[], &mut paths);
    }
    let parent = if is_folder { own } else { &own[..own.len() - 1] };
    let resolve = |path: Vec<String>| -> Option<Vec<String>> {
        match path.first()?.as_str() {
            "crate" => Some(path[1..].to_vec()),
            "super" => Some([parent, &path[1..]].concat()),
            name if is_folder => Some([own, &[name.to_owned()], &path[1..]].concat()),
            _ => None,
        }
    };
    paths.into_iter().filter_map(resolve).collect()
}

/// `a::{b,c::d}` as `a::b` and `a::c::d`.
fn spread(text: &str, before: &[String], paths: &mut Vec<Vec<String>>) {
    let (mut depth, mut start) = (0, 0);
    let mut parts = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&text[start..]);
    for part in parts.into_iter().filter(|part| !part.is_empty()) {
        let (head, group) = part.split_once('{').unwrap_or((part, ""));
        let names = head.split("::").filter(|name| !name.is_empty());
        let path: Vec<String> = before.iter().cloned().chain(names.map(str::to_owned)).collect();
        match group.strip_suffix('}') {
            Some(group) => spread(group, &path, paths),
            None => paths.push(path),
        }
    }
}

#[test]
fn no_files_of_a_crate_use_each_other_in_a_circle() {
    let arrows: usize = roots().iter().map(|root| arrows_without_circle(root)).sum();
    assert!(arrows > 500, "only {arrows} arrows were found");
}

/// Uses between the files of a crate, none of which is in a circle.
fn arrows_without_circle(root: &Path) -> usize {
    let mut files = Vec::new();
    sources(root, &mut files);
    let modules: BTreeMap<Vec<String>, PathBuf> =
        files.iter().map(|file| (module_path(root, file), file.clone())).collect();
    // A folder's mod.rs hands names on: they count as used of the files that have them.
    let handed: BTreeMap<Vec<String>, Vec<Vec<String>>> = modules
        .iter()
        .filter(|(_, file)| file.ends_with("mod.rs"))
        .map(|(path, file)| {
            let text = std::fs::read_to_string(file).expect("text");
            (path.clone(), used_paths(path, true, &text))
        })
        .collect();
    let owner = |path: &[String]| -> Option<Vec<String>> {
        let length = (1..=path.len()).rev().find(|&n| modules.contains_key(&path[..n]))?;
        let (module, rest) = path.split_at(length);
        match (handed.get(module), rest.first()) {
            (Some(handed), Some(name)) => {
                let source = handed.iter().find(|path| path.last() == Some(name))?;
                let length =
                    (1..source.len()).rev().find(|&n| modules.contains_key(&source[..n]))?;
                Some(source[..length].to_vec())
            }
            _ => Some(module.to_vec()),
        }
    };
    let mut arrows: BTreeMap<Vec<String>, Vec<Vec<String>>> = BTreeMap::new();
    for (path, file) in modules.iter().filter(|(_, file)| !file.ends_with("mod.rs")) {
        let text = std::fs::read_to_string(file).expect("text");
        let used = used_paths(path, false, &text);
        let others = used.iter().filter_map(|used| owner(used)).filter(|other| other != path);
        arrows.insert(path.clone(), others.collect());
    }
    let count = arrows.values().map(Vec::len).sum();
    // Files that use none of the others are taken away, and files that none uses: circles stay.
    loop {
        let used: Vec<_> = arrows.values().flatten().cloned().collect();
        let before = arrows.len();
        let left: Vec<_> = arrows.keys().cloned().collect();
        arrows.retain(|path, others| {
            others.iter().any(|other| left.contains(other)) && used.contains(path)
        });
        if arrows.len() == before {
            break;
        }
    }
    let circle: Vec<String> = arrows.keys().map(|path| path.join("/")).collect();
    assert!(circle.is_empty(), "files in circles: {circle:?}");
    count
}

/// Functions of std whose last bits differ from machine to machine; `libm` has the same everywhere.
const INEXACT: [&str; 16] = [
    "exp", "exp2", "exp_m1", "ln", "ln_1p", "log2", "log10", "powf", "cbrt", "sin", "cos",
    "sin_cos", "tan", "tanh", "atan2", "mul_add",
];

#[test]
fn what_is_stored_is_computed_the_same_on_every_machine() {
    let mut files = Vec::new();
    roots().iter().for_each(|root| sources(root, &mut files));
    let mut held = 0;
    for file in files {
        let relative = file.to_string_lossy().into_owned();
        // The program's own files store nothing.
        if !relative.contains("/crates/") {
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
