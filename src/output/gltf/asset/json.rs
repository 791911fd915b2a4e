//! JSON in place: where values stand in a text, and edits of the text that touch nothing else.
//!
//! A document that somebody else wrote keeps its key order, spelling of numbers, white space and
//! everything that nobody here knows, because only the edited ranges of its text change. What is
//! appended to a list and removed again leaves no trace.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;

use crate::base::error::{Error, Place, Result};

/// A value in the text of a document.
#[derive(Debug, Clone)]
pub struct Node<'a> {
    text: &'a str,
    /// Offset of the value in the document's text.
    start: usize,
    pointer: String,
}

/// The members of an object or the elements of an array, in the order of the text.
#[derive(Debug)]
pub struct List<'a> {
    /// The object or array itself.
    of: Node<'a>,
    /// Name of each member; its number for elements.
    names: Vec<String>,
    values: Vec<Node<'a>>,
    /// Where each item starts: at its key or value.
    starts: Vec<usize>,
}

impl<'a> Node<'a> {
    /// The root of a document, whose whole syntax is checked.
    pub fn document(text: &'a str) -> Result<Self> {
        let root: &RawValue =
            serde_json::from_str(text).map_err(|error| bad_syntax(&error, String::new()))?;
        Ok(Self::of(root, text, 0, String::new()))
    }

    fn of(raw: &'a RawValue, text: &'a str, base: usize, pointer: String) -> Self {
        let start = base + (raw.get().as_ptr() as usize - text.as_ptr() as usize);
        Self { text: raw.get(), start, pointer }
    }

    /// The value as it is written.
    pub fn text(&self) -> &'a str {
        self.text
    }

    /// Where it stands in the document's text.
    pub fn range(&self) -> Range<usize> {
        self.start..self.start + self.text.len()
    }

    /// Its JSON pointer.
    pub fn pointer(&self) -> &str {
        &self.pointer
    }

    /// Its place, for errors.
    pub fn place(&self) -> Place {
        Place::Pointer(self.pointer.clone())
    }

    /// The members of an object; each name may be there once.
    pub fn members(&self) -> Result<List<'a>> {
        let Members(found) = self.parse("an object")?;
        let (names, values): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let mut seen = BTreeSet::new();
        for name in &names {
            if !seen.insert(name) {
                let found = format!("the key {name:?} a second time");
                return Err(Error::malformed(self.place(), found, "each key once"));
            }
        }
        Ok(self.list(names, values))
    }

    /// The elements of an array.
    pub fn elements(&self) -> Result<List<'a>> {
        let Elements(values) = self.parse("an array")?;
        Ok(self.list((0..values.len()).map(|i| i.to_string()).collect(), values))
    }

    fn list(&self, names: Vec<String>, values: Vec<&'a RawValue>) -> List<'a> {
        let child = |(name, raw): (&String, &'a RawValue)| {
            let name = name.replace('~', "~0").replace('/', "~1");
            Self::of(raw, self.text, self.start, format!("{}/{name}", self.pointer))
        };
        let values: Vec<Node> = names.iter().zip(values).map(child).collect();
        let mut starts = Vec::new();
        let mut after = 1;
        for value in &values {
            // Between two items there is white space and a comma, nothing else.
            let gap = self.text.get(after..).unwrap_or_default();
            let item = gap.trim_start_matches([',', ' ', '\t', '\n', '\r']);
            starts.push(self.start + self.text.len() - item.len());
            after = value.range().end - self.start;
        }
        List { of: self.clone(), names, values, starts }
    }

    /// A member of an object, if it is there.
    pub fn get(&self, name: &str) -> Result<Option<Node<'a>>> {
        Ok(self.members()?.get(name).cloned())
    }

    /// The value as a type that serde reads.
    pub fn parse<T: Deserialize<'a>>(&self, expected: &str) -> Result<T> {
        serde_json::from_str(self.text)
            .map_err(|error| Error::malformed(self.place(), short(self.text, &error), expected))
    }

    /// A whole number from 0.
    pub fn index(&self) -> Result<usize> {
        self.parse("a whole number from 0")
    }
}

impl<'a> List<'a> {
    /// Values in order.
    pub fn values(&self) -> &[Node<'a>] {
        &self.values
    }

    /// Names and values in order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Node<'a>)> {
        self.names.iter().map(String::as_str).zip(&self.values)
    }

    /// A member by name.
    pub fn get(&self, name: &str) -> Option<&Node<'a>> {
        self.iter().find(|(own, _)| *own == name).map(|(_, value)| value)
    }

    /// Items.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    fn number(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|own| own == name)
    }
}

/// Changes of a document's text, all counted in the text as it was.
#[derive(Debug, Default)]
pub struct Edits {
    changes: Vec<(Range<usize>, String)>,
}

impl Edits {
    /// Puts other text in the place of a value.
    pub fn replace(&mut self, value: &Node, text: impl Into<String>) {
        self.changes.push((value.range(), text.into()));
    }

    /// Appends an element to an array, or a member, `"name":value`, to an object.
    pub fn append(&mut self, list: &List, item: &str) {
        let (at, comma) = match list.values.last() {
            Some(last) => (last.range().end, ","),
            None => (list.of.start + 1, ""),
        };
        self.changes.push((at..at, format!("{comma}{item}")));
    }

    /// Removes items by their numbers.
    pub fn remove(&mut self, list: &List, numbers: &[usize]) {
        let kept = |i: usize| !numbers.contains(&i);
        for (i, value) in list.values.iter().enumerate().filter(|(i, _)| !kept(*i)) {
            let end = value.range().end;
            let before = list.values.iter().take(i).enumerate().any(|(j, _)| kept(j));
            let range = match (i.checked_sub(1).and_then(|j| list.values.get(j)), before) {
                // With the comma before it, or, where nothing stays before it, the one after it.
                (Some(previous), true) => previous.range().end..end,
                _ => start(list, i)..list.starts.get(i + 1).copied().unwrap_or(end),
            };
            self.changes.push((range, String::new()));
        }
    }

    /// Removes a member by its name.
    pub fn remove_member(&mut self, list: &List, name: &str) {
        if let Some(number) = list.number(name) {
            self.remove(list, &[number]);
        }
    }

    /// The text with all changes made. Changes do not overlap.
    pub fn apply(mut self, text: &str) -> String {
        // Stable: what is appended at one place stays in the order it was appended in.
        self.changes.sort_by_key(|(range, _)| (range.start, range.end));
        let mut out = String::with_capacity(text.len());
        let mut at = 0;
        for (range, new) in &self.changes {
            out += text.get(at..range.start).unwrap_or_default();
            out += new;
            at = range.end;
        }
        out + text.get(at..).unwrap_or_default()
    }
}

fn start(list: &List, i: usize) -> usize {
    list.starts.get(i).copied().unwrap_or(list.of.start)
}

struct Members<'a>(Vec<(String, &'a RawValue)>);
struct Elements<'a>(Vec<&'a RawValue>);

impl<'de: 'a, 'a> Deserialize<'de> for Members<'a> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Collect;
        impl<'de> Visitor<'de> for Collect {
            type Value = Members<'de>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                write!(f, "an object")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let mut found = Vec::new();
                while let Some(member) = map.next_entry()? {
                    found.push(member);
                }
                Ok(Members(found))
            }
        }
        from.deserialize_map(Collect)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for Elements<'a> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Collect;
        impl<'de> Visitor<'de> for Collect {
            type Value = Elements<'de>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                write!(f, "an array")
            }

            fn visit_seq<A: SeqAccess<'de>>(
                self,
                mut list: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let mut found = Vec::new();
                while let Some(element) = list.next_element()? {
                    found.push(element);
                }
                Ok(Elements(found))
            }
        }
        from.deserialize_seq(Collect)
    }
}

fn bad_syntax(error: &serde_json::Error, pointer: String) -> Error {
    let found = format!("text that is no JSON: {error}");
    Error::malformed(Place::Pointer(pointer), found, "a JSON document")
}

/// A value as an error shows it.
fn short(text: &str, error: &serde_json::Error) -> String {
    let shown: String = text.chars().take(40).collect();
    let more = if shown.len() < text.len() { "..." } else { "" };
    format!("{shown}{more} ({error})")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        " { \"a\" : [ 1.50 , { } ,\n 2e1 ] , \"b/c\" : \"x\" , \"d\" : { \"e\" : null } } ";

    fn changed(edit: impl FnOnce(&Node, &mut Edits)) -> String {
        let root = Node::document(TEXT).expect("JSON");
        let mut edits = Edits::default();
        edit(&root, &mut edits);
        edits.apply(TEXT)
    }

    #[test]
    fn values_know_where_they_stand() {
        let root = Node::document(TEXT).expect("JSON");
        let a = root.get("a").expect("an object").expect("there").elements().expect("an array");
        let texts: Vec<&str> = a.values().iter().map(Node::text).collect();
        assert_eq!(texts, ["1.50", "{ }", "2e1"]);
        for value in a.values() {
            assert_eq!(&TEXT[value.range()], value.text());
        }
        let odd = root.get("b/c").expect("an object").expect("there");
        assert_eq!(odd.pointer(), "/b~1c");
        assert!(odd.elements().is_err() && odd.members().is_err() && odd.index().is_err());
        let twice = Node::document(r#"{"a":1,"a":2}"#).expect("JSON").members();
        assert!(twice.expect_err("twice").to_string().contains("second time"));
        for bad in ["", "{", "{\"a\":}", "[1,]", "{} {}", "nul", "\u{feff}{}"] {
            assert!(Node::document(bad).is_err(), "{bad:?}");
        }
    }

    fn list<'a>(root: &Node<'a>, pointer: &str) -> Result<List<'a>> {
        match pointer {
            "" => root.members(),
            "a" => root.get("a").and_then(|a| a.expect("there").elements()),
            other => root.get(other).and_then(|o| o.expect("there").members()),
        }
    }

    #[test]
    fn what_is_appended_and_removed_leaves_no_trace() {
        for (pointer, item) in [("", "\"n\":[1,2]"), ("a", "7"), ("d", "\"f\":1")] {
            let longer =
                changed(|root, edits| edits.append(&list(root, pointer).expect("a list"), item));
            let root = Node::document(&longer).expect("still JSON");
            let items = list(&root, pointer).expect("a list");
            let mut edits = Edits::default();
            edits.remove(&items, &[items.len() - 1]);
            assert_eq!(edits.apply(&longer), TEXT);
        }
    }

    #[test]
    fn any_items_can_go() {
        for set in 0..8usize {
            let numbers: Vec<usize> = (0..3).filter(|i| set >> i & 1 == 1).collect();
            let left = changed(|root, edits| {
                let a = root.get("a").expect("an object").expect("there");
                edits.remove(&a.elements().expect("an array"), &numbers);
                edits.remove(&root.members().expect("an object"), &[1]);
            });
            let left: serde_json::Value = serde_json::from_str(&left).expect("still JSON");
            let all = [serde_json::json!(1.5), serde_json::json!({}), serde_json::json!(20.0)];
            let want: Vec<_> = (0..3).filter(|i| set >> i & 1 == 0).map(|i| &all[i]).collect();
            assert_eq!(left, serde_json::json!({ "a": want, "d": { "e": null } }));
        }
    }
}
