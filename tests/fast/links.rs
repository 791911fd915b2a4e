//! Links of all pages lead somewhere, and the book lists every page.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::pages::{anchors, links, listed, normal, prose, text};
use crate::common::root;

/// Folders that hold other people's pages, or products.
const FOREIGN: [&str; 5] = ["target", "node_modules", ".git", "build", "corpus"];

fn pages_under(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(root().join(folder)).expect("a folder");
    for entry in entries.map(|entry| entry.expect("an entry")) {
        let name = entry.file_name();
        let path = folder.join(&name);
        if entry.file_type().expect("a type").is_dir() {
            if !FOREIGN.iter().any(|foreign| name == *foreign) {
                pages_under(&path, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

fn all_pages() -> Vec<PathBuf> {
    let mut found = Vec::new();
    pages_under(Path::new(""), &mut found);
    found
}

/// Head and tail of a page that a program writes: links are relative to that page.
fn folder_of(page: &Path) -> &Path {
    match page.starts_with("tests/support") {
        true => Path::new("formats"),
        false => page.parent().expect("a folder"),
    }
}

#[test]
fn every_relative_link_leads_somewhere() {
    let mut broken = Vec::new();
    let mut checked = 0;
    for page in all_pages() {
        let own = text(&page);
        for link in links(&own) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            checked += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = match path {
                "" => Some(page.clone()),
                path => normal(&folder_of(&page).join(path)),
            };
            let there = target.as_ref().filter(|target| root().join(target).exists());
            let leads = there
                .is_some_and(|target| anchor.is_empty() || anchors(&text(target)).contains(anchor));
            if !leads {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(checked > 100, "{checked} links");
    assert!(broken.is_empty(), "broken links:\n{}", broken.join("\n"));
}

#[test]
fn the_book_lists_every_page_once() {
    let listed = listed();
    let unique: BTreeSet<_> = listed.iter().cloned().collect();
    assert_eq!(unique.len(), listed.len(), "a page is listed twice");
    // Pages of tests are for those who work on the code.
    let pages = all_pages().into_iter().filter(|page| !page.starts_with("tests"));
    let pages: BTreeSet<_> = pages.collect();
    assert_eq!(unique, pages);
}

#[test]
fn prose_is_wrapped_and_begins_with_one_title() {
    let mut wrong = Vec::new();
    for page in listed() {
        let text = text(&page);
        if !text.starts_with("# ") {
            wrong.push(format!("{}: no title", page.display()));
        }
        for (index, line) in text.lines().enumerate() {
            // A link or a command cannot be broken.
            let words = line.split_whitespace().count();
            let is_prose = !line.starts_with('|') && prose(&text).lines().any(|kept| kept == line);
            if is_prose && line.chars().count() > 100 && words > 3 {
                wrong.push(format!("{}:{}: over 100 columns", page.display(), index + 1));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn anchors_are_those_of_headings() {
    let text = "# A page\n\n## `bake`\n\n## Size, and error\n## `bake`\n```sh\n# no heading\n```\n";
    let expected = ["a-page", "bake", "bake-1", "size-and-error"];
    assert_eq!(anchors(text), expected.map(str::to_owned).into());
    assert_eq!(links("[a](b.md#c) `x` ![d](e.png)\n```\n[no](link)\n```\n"), ["b.md#c", "e.png"]);
    assert_eq!(normal(Path::new("docs/../../x")), None);
}
