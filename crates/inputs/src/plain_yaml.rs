//! The plain values of a YAML text.
//!
//! Training programs write their configuration as YAML; nerfstudio adds tags that name Python
//! classes. No objects are built here: lines are split into keys and values by indentation, and
//! tags, anchors and references stay text. Lists and dictionaries in brackets may hold plain
//! values.

use std::collections::BTreeMap;

/// Values by their path: keys and numbers of items, with dots between.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Plain(BTreeMap<String, String>);

/// An open key or item, to which the next lines may belong.
struct Level {
    indent: usize,
    name: String,
    /// The number of an item.
    item: Option<usize>,
}

impl Plain {
    /// Reads the lines of a text.
    pub(crate) fn read(text: &str) -> Self {
        let mut found = Self::default();
        let mut levels: Vec<Level> = Vec::new();
        for line in text.lines() {
            let content = line.trim_start_matches(' ');
            let mut indent = line.len() - content.len();
            let mut content = content.trim_end();
            if content.starts_with('#') {
                continue;
            }
            while let Some(rest) = content.strip_prefix("- ").or(content.strip_prefix('-')) {
                if !(content.starts_with("- ") || content == "-") {
                    break;
                }
                found.item(&mut levels, indent);
                content = rest.trim_start_matches(' ');
                indent += 2;
            }
            let Some((key, value)) = split(content) else {
                found.add(&levels, content);
                continue;
            };
            while levels.last().is_some_and(|level| level.indent >= indent) {
                levels.pop();
            }
            levels.push(Level { indent, name: key.to_owned(), item: None });
            found.add(&levels, value);
        }
        found
    }

    /// Enters the next item of the list at an indentation.
    fn item(&self, levels: &mut Vec<Level>, indent: usize) {
        let mut number = 0;
        while let Some(last) = levels.last() {
            // Items are indented at least as far as the key of their list.
            let is_list = last.indent == indent && last.item.is_none();
            if last.indent < indent || is_list {
                break;
            }
            if last.indent == indent {
                number = last.item.map_or(0, |number| number + 1);
            }
            levels.pop();
        }
        levels.push(Level { indent, name: number.to_string(), item: Some(number) });
    }

    fn add(&mut self, levels: &[Level], value: &str) {
        if value.is_empty() || levels.is_empty() {
            return;
        }
        let names: Vec<&str> = levels.iter().map(|level| level.name.as_str()).collect();
        let path = names.join(".");
        let within = |open, close| plain(value).strip_prefix(open)?.strip_suffix(close);
        if let Some(items) = within('[', ']') {
            for (number, item) in items.split(',').enumerate() {
                self.0.insert(format!("{path}.{number}"), item.trim().to_owned());
            }
        } else if let Some(entries) = within('{', '}') {
            for (key, value) in entries.split(',').filter_map(|entry| entry.split_once(':')) {
                self.0.insert(format!("{path}.{}", key.trim()), value.trim().to_owned());
            }
        } else {
            self.0.insert(path, value.to_owned());
        }
    }

    /// The text at a path, with its tag.
    pub(crate) fn text(&self, path: &str) -> Option<&str> {
        self.0.get(path).map(String::as_str)
    }

    /// The value at a path, without tags and quotes; none for null.
    pub(crate) fn value(&self, path: &str) -> Option<&str> {
        let value = plain(self.text(path)?);
        let value = value.split(" #").next().unwrap_or_default().trim_end();
        let unquoted = value.trim_matches(['\'', '"']);
        (!matches!(value, "" | "null" | "~")).then_some(unquoted)
    }
}

/// A key, and the value on its line.
fn split(content: &str) -> Option<(&str, &str)> {
    if content.starts_with(['!', '[', '{', '\'', '"', '&', '*']) {
        return None;
    }
    match content.split_once(": ") {
        Some((key, value)) => Some((key, value.trim())),
        None => content.strip_suffix(':').map(|key| (key, "")),
    }
}

/// A value without the tags and anchors before it.
fn plain(value: &str) -> &str {
    let mut value = value;
    while value.starts_with(['!', '&']) {
        value = value.split_once(' ').map_or("", |(_, rest)| rest.trim_start());
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_their_paths() {
        let found = Plain::read(
            "!!python/object:a.Config\n_target: !!python/name:a.B ''\npipeline: &id !!python/object:p\n\
             \x20 model: !!python/object:m\n    far: 1.0e+3\n    none: null\n    wide: !!python/tuple\n\
             \x20   - 64\n    - 32\n    nets:\n    - hidden: 16\n      res: 128\n    - hidden: 8\n\
             \x20   flow: [1, 2]\n    pairs: {a: 1, b: x}\n    name: 'quoted'\nlast: true  # said\n\
             list:\n  - a\n  - - b\n    - c\n",
        );
        for (path, value) in [
            ("pipeline.model.far", Some("1.0e+3")),
            ("pipeline.model.none", None),
            ("pipeline.model.wide.0", Some("64")),
            ("pipeline.model.wide.1", Some("32")),
            ("pipeline.model.nets.0.hidden", Some("16")),
            ("pipeline.model.nets.0.res", Some("128")),
            ("pipeline.model.nets.1.hidden", Some("8")),
            ("pipeline.model.flow.1", Some("2")),
            ("pipeline.model.pairs.b", Some("x")),
            ("pipeline.model.name", Some("quoted")),
            ("last", Some("true")),
            ("list.0", Some("a")),
            ("list.1.1", Some("c")),
            ("pipeline", None),
            ("far", None),
        ] {
            assert_eq!(found.value(path), value, "{path}: {found:?}");
        }
        assert_eq!(found.text("_target"), Some("!!python/name:a.B ''"));
    }

    #[test]
    fn other_texts_are_no_trouble() {
        for text in
            ["", "-", "- - - -", ": :", "a", "\t\u{0}:\n-x: y", "!", "& ", "[", "a: [", "é: é"]
        {
            Plain::read(text);
        }
    }
}
