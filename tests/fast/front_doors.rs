//! A crate's front door exports every type that its signatures use, or re-exports the crate that does.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Crates and those whose types they may leave to a re-exported crate, lowest first.
const CRATES: [(&str, &[&str]); 3] =
    [("format", &[]), ("mipvog", &["format"]), ("inputs", &["format", "mipvog"])];

/// What a crate's sources define at the top level of files.
#[derive(Default)]
struct Sources {
    /// Types, by their names.
    types: BTreeSet<String>,
    /// Names that the public fields and methods of a type use.
    signatures: BTreeMap<String, BTreeSet<String>>,
}

impl Sources {
    fn read(folder: &Path) -> Self {
        let mut sources = Self::default();
        for file in files(folder) {
            let text = std::fs::read_to_string(&file).expect("text");
            let code = text.split("#[cfg(test)]\nmod tests").next().expect("code");
            let code: String = code.lines().map(without_comment).collect();
            if !file.ends_with("lib.rs") {
                sources.add(&code);
            }
        }
        sources
    }

    fn add(&mut self, code: &str) {
        for kind in ["struct", "enum", "trait", "type"] {
            for (name, rest) in items(code, &format!("\npub {kind} ")) {
                let head = rest.find(['{', ';', '(']).unwrap_or(rest.len());
                let body = block(&rest[head..]);
                let used: Vec<&str> = match kind {
                    "struct" if body.starts_with('(') => body.split(',').collect(),
                    "struct" => body.lines().filter(|line| line.contains("    pub ")).collect(),
                    // Of a variant, what it holds.
                    "enum" => body
                        .lines()
                        .filter_map(|line| line.split_once(['(', ':']))
                        .map(|l| l.1)
                        .collect(),
                    "trait" => body
                        .split("fn ")
                        .skip(1)
                        .filter_map(|f| f.split(['{', ';']).next())
                        .collect(),
                    _ => vec![rest.split(';').next().unwrap_or_default()],
                };
                self.use_names(name, &used);
                self.types.insert(name.to_owned());
            }
        }
        // Inherent methods.
        for (at, _) in code.match_indices("\nimpl") {
            let head = code[at + 5..].split('{').next().unwrap_or_default();
            if head.contains(" for ") {
                continue;
            }
            let head = head.split_once("> ").map_or(head, |(_, name)| name).trim();
            let name: String = head.chars().take_while(|c| c.is_alphanumeric()).collect();
            let body = block(&code[at + 5 + code[at + 5..].find('{').unwrap_or(0)..]);
            for method in body.split("    pub ").skip(1) {
                let signature = method.split(['{', ';']).next().unwrap_or_default();
                let before = body[..body.find(method).unwrap_or(0)].trim_end();
                if !before.trim_end_matches("pub").trim_end().ends_with("#[doc(hidden)]") {
                    self.use_names(&name, &[signature]);
                }
            }
        }
    }

    fn use_names(&mut self, item: &str, texts: &[&str]) {
        let names = texts.iter().flat_map(|text| capitalized(text));
        self.signatures.entry(item.to_owned()).or_default().extend(names);
    }
}

/// Items that follow `introduction`: the name, and the text behind it.
fn items<'a>(code: &'a str, introduction: &str) -> Vec<(&'a str, &'a str)> {
    let found = code.match_indices(introduction);
    let rests = found.map(|(at, _)| &code[at + introduction.len()..]);
    rests
        .map(|rest| {
            rest.split_at(rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(0))
        })
        .collect()
}

/// The text up to the end of its first pair of brackets, or to a semicolon.
fn block(text: &str) -> &str {
    let mut depth = 0;
    for (at, c) in text.char_indices() {
        match c {
            '{' | '(' => depth += 1,
            '}' | ')' if depth == 1 => return &text[..at],
            '}' | ')' => depth -= 1,
            ';' if depth == 0 => return &text[..at],
            _ => {}
        }
    }
    text
}

fn without_comment(line: &str) -> String {
    let code = line.split("//").next().unwrap_or_default();
    format!("{code}\n")
}

/// Types of std that share their names with types of the crates.
const OF_STD: [&str; 2] = ["Path", "Value"];

/// Words that start with a capital letter, as types do.
fn capitalized(text: &str) -> Vec<String> {
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    let is_type = |word: &&str| {
        word.len() > 1
            && word.starts_with(|c: char| c.is_ascii_uppercase())
            && word.contains(|c: char| c.is_ascii_lowercase())
            && !OF_STD.contains(word)
    };
    words.filter(is_type).map(str::to_owned).collect()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let inner = folders.iter().flat_map(|folder| self::files(folder));
    files
        .into_iter()
        .chain(inner)
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .collect()
}

/// The names that a crate's `lib.rs` exports, but for hidden ones.
fn front_door(lib: &str) -> BTreeSet<String> {
    let code: String = lib.lines().map(without_comment).collect();
    let uses = code.split("\npub use ").skip(1).filter(|part| !part.is_empty());
    let hidden: BTreeSet<&str> = code
        .split("#[doc(hidden)]\npub use ")
        .skip(1)
        .filter_map(|part| part.split(';').next())
        .collect();
    let uses = uses.filter_map(|part| part.split(';').next()).filter(|part| !hidden.contains(part));
    // Of a path the last part counts, or what stands in braces.
    let listed = uses.map(|part| {
        part.split_once('{')
            .map_or_else(|| part.rsplit("::").next().unwrap_or_default(), |(_, list)| list)
    });
    let names = listed.flat_map(|part| part.split(|c: char| !c.is_alphanumeric() && c != '_'));
    names.filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

#[test]
fn front_doors_export_what_their_signatures_use() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates");
    let mut doors: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (name, below) in CRATES {
        let sources = Sources::read(&folder.join(name).join("src"));
        let lib = std::fs::read_to_string(folder.join(name).join("src/lib.rs")).expect("text");
        let door = front_door(&lib);
        let mut checked = 0;
        for item in &door {
            for used in sources.signatures.get(item).into_iter().flatten() {
                checked += 1;
                let is_below = below.iter().any(|other| doors[other].contains(used));
                assert!(
                    !sources.types.contains(used) || door.contains(used) || is_below,
                    "crate {name}: {item} uses {used}, which lib.rs does not export"
                );
            }
        }
        assert!(checked > 20, "crate {name}: only {checked} uses were found");
        doors.insert(name, door);
    }
}
