//! Values of a JSON document with their places, parsed lazily.

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::base::error::{Error, Place, Result};

/// A value in the text of a document.
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct Node<'a> {
    raw: &'a RawValue,
    #[serde(skip)]
    pointer: String,
}

/// The members of an object, in the order of the text. For duplicate names, the last value counts.
pub type Members<'a> = IndexMap<String, Node<'a>>;

impl<'a> Node<'a> {
    /// The root of a document, whose whole syntax is checked.
    pub fn document(text: &'a str) -> Result<Self> {
        let raw = serde_json::from_str(text).map_err(|error| {
            let found = format!("text that is not JSON: {error}");
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

    /// A member of an object, if present.
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

    /// A non-negative integer. Some writers make all numbers floats, so 4.0 counts as 4.
    pub fn index(&self) -> Result<usize> {
        let expected = "a whole number from 0";
        let number = whole(&self.parse(expected)?);
        let number = number.and_then(|number| usize::try_from(number).ok());
        number.ok_or_else(|| Error::malformed(self.place(), self.raw.get().to_owned(), expected))
    }

    /// Visits every member of every object, at any depth, in the order of the text. Numbers are not
    /// parsed: a document may hold some that no type can represent.
    ///
    /// # Errors
    /// Too deeply nested objects and arrays.
    pub fn visit(&self, visit: &mut dyn FnMut(&str, &Node<'a>)) -> Result<()> {
        match self.raw.get().as_bytes().first() {
            Some(b'{') => self.members()?.iter().try_for_each(|(name, value)| {
                visit(name, value);
                value.visit(visit)
            }),
            Some(b'[') => self.elements()?.iter().try_for_each(|element| element.visit(visit)),
            _ => Ok(()),
        }
    }
}

/// The number, if it is a non-negative integer.
fn whole(number: &serde_json::Number) -> Option<u64> {
    /// From here on, floats cannot represent every integer.
    const LARGEST: f64 = 9_007_199_254_740_992.0;
    let float = number.as_f64().filter(|float| float.fract() == 0.0);
    number.as_u64().or_else(|| {
        let float = float.filter(|float| (0.0..LARGEST).contains(float));
        #[expect(clippy::cast_possible_truncation, reason = "a whole number in range")]
        float.map(|float| float as u64)
    })
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
        let number = |text: &str| {
            let raw = serde_json::value::RawValue::from_string(text.to_owned()).expect("JSON");
            Node { raw: &raw, pointer: String::new() }.index().ok()
        };
        assert_eq!(["7", "4.0", "2e1", "0.0"].map(number), [Some(7), Some(4), Some(20), Some(0)]);
        assert_eq!(["-1", "1.5", "1e400", "1e20", "\"1\""].map(number), [None; 5]);
        let mut seen = Vec::new();
        root.visit(&mut |name, _| seen.push(name.to_owned())).expect("JSON");
        assert_eq!(seen, ["a", "b/c"]);
        let odd = root.get("b/c").expect("an object").expect("there");
        assert_eq!(odd.pointer(), "/b~1c");
        assert!(odd.elements().is_err() && odd.members().is_err() && odd.index().is_err());
        for bad in ["", "{", "{\"a\":}", "[1,]", "{} {}", "nul", "\u{feff}{}"] {
            assert!(Node::document(bad).is_err(), "{bad:?}");
        }
    }
}
