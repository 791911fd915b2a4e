//! Values of a JSON document, with their places, read only as far as they are looked at.

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::base::error::{Error, Place, Result};

/// A value as the text of a document has it.
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct Node<'a> {
    raw: &'a RawValue,
    #[serde(skip)]
    pointer: String,
}

/// The members of an object, in the order of the text. Of a name that is there twice, the last
/// value counts.
pub type Members<'a> = IndexMap<String, Node<'a>>;

impl<'a> Node<'a> {
    /// The root of a document, whose whole syntax is checked.
    pub fn document(text: &'a str) -> Result<Self> {
        let raw = serde_json::from_str(text).map_err(|error| {
            let found = format!("text that is no JSON: {error}");
            Error::malformed(Place::Pointer(String::new()), found, "a JSON document")
        })?;
        Ok(Self { raw, pointer: String::new() })
    }

    /// Its JSON pointer (RFC 6901).
    pub fn pointer(&self) -> &str {
        &self.pointer
    }

    /// Its place, for errors.
    pub fn place(&self) -> Place {
        Place::Pointer(self.pointer.clone())
    }

    /// The members of an object.
    pub fn members(&self) -> Result<Members<'a>> {
        let members: IndexMap<String, &'a RawValue> = self.parse("an object")?;
        let child = |(name, raw): (String, &'a RawValue)| {
            let escaped = name.replace('~', "~0").replace('/', "~1");
            (name, Self { raw, pointer: format!("{}/{escaped}", self.pointer) })
        };
        Ok(members.into_iter().map(child).collect())
    }

    /// The elements of an array.
    pub fn elements(&self) -> Result<Vec<Self>> {
        let elements: Vec<&'a RawValue> = self.parse("an array")?;
        let child = |(i, raw)| Self { raw, pointer: format!("{}/{i}", self.pointer) };
        Ok(elements.into_iter().enumerate().map(child).collect())
    }

    /// A member of an object, if it is there.
    pub fn get(&self, name: &str) -> Result<Option<Self>> {
        Ok(self.members()?.swap_remove(name))
    }

    /// The value as a type that serde reads.
    pub fn parse<T: Deserialize<'a>>(&self, expected: &str) -> Result<T> {
        let text = self.raw.get();
        serde_json::from_str(text).map_err(|error| {
            let shown: String = text.chars().take(40).collect();
            let more = if shown.len() < text.len() { "..." } else { "" };
            Error::malformed(self.place(), format!("{shown}{more} ({error})"), expected)
        })
    }

    /// A whole number from 0.
    pub fn index(&self) -> Result<usize> {
        self.parse("a whole number from 0")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_know_their_places() {
        let text = r#" { "a" : [ 1.50 , { } , 2e1 ] , "b/c" : "x" } "#;
        let root = Node::document(text).expect("JSON");
        let a = root.get("a").expect("an object").expect("there").elements().expect("an array");
        let texts: Vec<&str> = a.iter().map(|node| node.raw.get()).collect();
        assert_eq!(texts, ["1.50", "{ }", "2e1"]);
        assert_eq!(a[1].pointer(), "/a/1");
        let odd = root.get("b/c").expect("an object").expect("there");
        assert_eq!(odd.pointer(), "/b~1c");
        assert!(odd.elements().is_err() && odd.members().is_err() && odd.index().is_err());
        for bad in ["", "{", "{\"a\":}", "[1,]", "{} {}", "nul", "\u{feff}{}"] {
            assert!(Node::document(bad).is_err(), "{bad:?}");
        }
    }
}
