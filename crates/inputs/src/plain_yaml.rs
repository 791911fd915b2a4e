//! Plain values of YAML files, by the keys that lead to them.
//!
//! Configurations of trainings are YAML, often with tags that build objects of a program. Here they
//! are text: lines of `key: value`, nested by their indentation. Tags, anchors, lists and texts of
//! several lines are passed over, so nothing in a file is ever built or run.

use std::collections::BTreeMap;

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::text::without_mark;

/// Values by their keys, joined by dots.
#[derive(Debug, Default)]
pub(crate) struct PlainYaml {
    values: BTreeMap<String, String>,
}

impl PlainYaml {
    /// The plain values of a text.
    ///
    /// # Errors
    /// `Malformed` for bytes that are no UTF-8, `OverLimit` for more lines than entries may be.
    pub(crate) fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        let text = str::from_utf8(without_mark(bytes)).map_err(|error| {
            Error::malformed(Place::File, error.to_string(), "settings in YAML, as UTF-8")
        })?;
        let mut values = BTreeMap::new();
        // The keys that the current line is below, with their indentation.
        let mut above: Vec<(usize, &str)> = Vec::new();
        for (number, line) in (1u64..).zip(text.lines()) {
            limits::check(LimitName::Entries, "lines", number, limits.entries, &Place::File)?;
            let content = line.trim_start();
            if content.is_empty() || content.starts_with(['#', '-', '%']) {
                continue;
            }
            let indentation = line.len() - content.len();
            while above.last().is_some_and(|(outer, _)| *outer >= indentation) {
                above.pop();
            }
            let Some((key, rest)) = key_of(content) else { continue };
            above.push((indentation, key));
            if let Some(value) = plain(rest) {
                let path: Vec<&str> = above.iter().map(|(_, key)| *key).collect();
                values.insert(path.join("."), value.to_owned());
            }
        }
        Ok(Self { values })
    }

    /// The text of a key.
    pub(crate) fn text(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(String::as_str)
    }

    /// The number of a key; none if there is no such key, or it is null.
    ///
    /// # Errors
    /// `Malformed` for another text.
    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some(text) = self.text(key).filter(|text| !matches!(*text, "null" | "~" | "None"))
        else {
            return Ok(None);
        };
        let number = text.replace('_', "").parse::<f64>().ok().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| unlike(key, text, "a finite number"))
    }

    /// The truth value of a key; none if there is no such key.
    ///
    /// # Errors
    /// `Malformed` for another text.
    pub(crate) fn boolean(&self, key: &str) -> Result<Option<bool>> {
        match self.text(key) {
            None => Ok(None),
            Some("true" | "True" | "TRUE") => Ok(Some(true)),
            Some("false" | "False" | "FALSE") => Ok(Some(false)),
            Some(text) => Err(unlike(key, text, "true or false")),
        }
    }
}

fn unlike(key: &str, found: &str, expected: &str) -> Error {
    let found: String = found.chars().take(80).collect();
    Error::malformed(Place::Key(key.to_owned()), found, expected)
}

/// A line's key and what follows its colon.
fn key_of(content: &str) -> Option<(&str, &str)> {
    let (key, rest) = content.split_once(':')?;
    let key = key.trim_matches(['"', '\'']);
    let is_key = !key.is_empty() && !key.contains([' ', '{', '[']);
    (is_key && (rest.is_empty() || rest.starts_with(' '))).then_some((key, rest.trim()))
}

/// A value on one line; none of tags, anchors and collections.
fn plain(rest: &str) -> Option<&str> {
    let rest = rest.split(" #").next().unwrap_or_default().trim();
    let quoted = |mark: char| rest.strip_prefix(mark).and_then(|rest| rest.strip_suffix(mark));
    if let Some(text) = quoted('"').or_else(|| quoted('\'')) {
        return Some(text);
    }
    (!rest.is_empty() && !rest.starts_with(['!', '&', '*', '{', '[', '|', '>', '#']))
        .then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
!!python/object:Config
# a comment
model:
  samples: 3   # each
  white: True
  name: 'a: b'
  inner: &anchor !!python/object:Other
    size: 1_000
    list:
    - one: 1
  after: 2.5
flat: null
path: !!python/object/apply:pathlib.PosixPath
- outputs
";

    #[test]
    fn plain_values_are_found_by_their_keys() {
        let yaml = PlainYaml::parse(TEXT.as_bytes(), &Limits::default()).expect("text");
        assert_eq!(yaml.number("model.samples").expect("a number"), Some(3.0));
        assert_eq!(yaml.boolean("model.white").expect("a truth value"), Some(true));
        assert_eq!(yaml.text("model.name"), Some("a: b"));
        assert_eq!(yaml.number("model.inner.size").expect("a number"), Some(1000.0));
        assert_eq!(yaml.number("model.after").expect("a number"), Some(2.5));
        assert_eq!(yaml.number("flat").expect("null"), None);
        assert_eq!(yaml.text("path"), None);
        assert_eq!(yaml.text("model.inner"), None);
        assert!(yaml.boolean("model.samples").is_err());
        assert!(yaml.number("model.white").is_err());
        assert!(PlainYaml::parse(b"\xff", &Limits::default()).is_err());
    }
}
