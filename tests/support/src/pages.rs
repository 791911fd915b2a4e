//! The pages of the book, and the Markdown of the repository.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use super::root;

/// Text without its fenced blocks.
pub fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut kept = String::new();
    for line in text.lines() {
        let is_fence = line.trim_start().starts_with("```");
        if !fenced && !is_fence {
            kept.push_str(line);
            kept.push('\n');
        }
        fenced ^= is_fence;
    }
    kept
}

/// The targets of links and pictures.
pub fn links(text: &str) -> Vec<String> {
    // A link may be broken over lines between its words, never within its target.
    let prose = prose(text);
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    targets.map(str::to_owned).collect()
}

/// The anchors that headings make: lower case, words joined by dashes, repeated ones numbered.
pub fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    for line in prose(text).lines() {
        let Some(head) = line.strip_prefix('#').map(|rest| rest.trim_start_matches('#')) else {
            continue;
        };
        let Some(head) = head.strip_prefix(' ') else { continue };
        let kept = head.trim().chars().filter(|&c| c.is_alphanumeric() || " -_".contains(c));
        let name: String = kept.collect::<String>().to_lowercase().replace(' ', "-");
        let numbered = (1..).map(|number| format!("{name}-{number}"));
        let mut names = std::iter::once(name.clone()).chain(numbered);
        anchors.extend(names.find(|name| !anchors.contains(name)));
    }
    anchors
}

/// A path from the repository's root without `.` and `..`. `None` if it leaves the repository.
pub fn normal(path: &Path) -> Option<PathBuf> {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if !parts.pop() => return None,
            Component::ParentDir => {}
            part => parts.push(part),
        }
    }
    Some(parts)
}

/// The pages that the book lists, in its order, by their paths in the repository.
pub fn listed() -> Vec<PathBuf> {
    let summary = std::fs::read_to_string(root().join("docs/SUMMARY.md")).expect("the list");
    let paths = links(&summary).into_iter();
    paths.map(|link| normal(&Path::new("docs").join(link)).expect("in the repository")).collect()
}

/// A page's text.
pub fn text(page: &Path) -> String {
    let text = std::fs::read_to_string(root().join(page));
    text.unwrap_or_else(|error| panic!("{}: {error}", page.display()))
}

/// The pages of the manual, in the order of the book.
pub fn manual() -> Vec<(PathBuf, String)> {
    let pages = listed().into_iter().filter(|page| page.starts_with("docs"));
    let pages = pages.filter(|page| !page.starts_with("docs/pictures"));
    pages.map(|page| (page.clone(), text(&page))).collect()
}

/// Under each heading of the rules and of the pages of verbs: long options in the first cells of its
/// tables, and headings of the rules that the text links to. Names of verbs are in backquotes.
pub fn sections() -> BTreeMap<String, (BTreeSet<String>, Vec<String>)> {
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
