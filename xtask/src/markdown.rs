//! Markdown: tables of the specification.

use std::fmt::Write as _;

use crate::description::{Channels, Description};

/// A page whose text between `<!-- generated: NAME -->` and `<!-- end -->` is made anew.
///
/// # Panics
/// For a mark without an end, and a table that there is not.
pub fn page(text: &str, description: &Description) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("<!-- generated: ") {
        let (before, marked) = rest.split_at(at);
        let (mark, after) = marked.split_once("-->\n").expect("the mark ends");
        let name = mark.trim_start_matches("<!-- generated: ").trim();
        let (_, following) =
            after.split_once("<!-- end -->").unwrap_or_else(|| panic!("{name} has no end"));
        out += &format!("{before}{mark}-->\n{}<!-- end -->", table(name, description));
        rest = following;
    }
    out + rest
}

fn table(name: &str, description: &Description) -> String {
    match name {
        "features" => features(description),
        "atlases" => atlases(description),
        _ => keys(name, description),
    }
}

fn features(description: &Description) -> String {
    let mut out = "\n| bit | since | set just where |\n|---|---|---|\n".to_owned();
    for (bit, feature) in description.feature.iter().enumerate() {
        let major = description.version[0];
        writeln!(out, "| {bit} | {major}.{} | {} |", feature.since, feature.condition).ok();
    }
    out + "\n"
}

fn atlases(description: &Description) -> String {
    let mut out = "\n| chunk | values | channels |\n|---|---|---|\n".to_owned();
    for group in &description.group {
        let channels = match &group.channels {
            Channels::Count(count) => count.to_string(),
            Channels::Key(key) => format!("`{key}`"),
        };
        writeln!(out, "| {} | {} | {channels} |", group.kind, group.label).ok();
    }
    out + "\n"
}

/// The keys of an object.
fn keys(name: &str, description: &Description) -> String {
    let object = description.find_object(name).unwrap_or_else(|| panic!("no object {name}"));
    let mut out = "\n| key | holds |\n|---|---|\n".to_owned();
    let mut rows: Vec<(Vec<&str>, &str)> = Vec::new();
    for field in &object.fields {
        let holds = field
            .holds
            .as_deref()
            .unwrap_or_else(|| panic!("{name}.{}: it says nothing", field.key));
        match rows.last_mut() {
            Some((keys, same)) if *same == holds => keys.push(&field.key),
            _ => rows.push((vec![&field.key], holds)),
        }
    }
    for (keys, holds) in rows {
        let keys: Vec<String> = keys.iter().map(|key| format!("`{key}`")).collect();
        writeln!(out, "| {} | {holds} |", keys.join(", ")).ok();
    }
    out + "\n"
}
