//! A document being edited: only edited objects and lists are parsed and written anew.
//!
//! All others keep their text, including the order of keys, white space and number formats.

use indexmap::IndexMap;
use serde::Serialize;
use serde_json::Value;

use crate::base::error::{Error, Place, Result};
use crate::gltf::asset::json::Node;

/// A value of the document.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Tree<'a> {
    /// Unchanged.
    Kept(Node<'a>),
    /// Inserted.
    New(Value),
    /// An object with edited members.
    Object(IndexMap<String, Tree<'a>>),
    /// A list with edited elements.
    Array(Vec<Tree<'a>>),
}

impl<'a> Tree<'a> {
    /// The members of an object.
    pub(super) fn object(&mut self) -> Result<&mut IndexMap<String, Self>> {
        if let Self::Kept(node) = self {
            let members = node.members()?.into_iter();
            *self = Self::Object(members.map(|(name, node)| (name, Self::Kept(node))).collect());
        }
        match self {
            Self::Object(members) => Ok(members),
            _ => Err(Error::malformed(Place::File, "a new value", "an object")),
        }
    }

    /// The elements of a list.
    pub(super) fn array(&mut self) -> Result<&mut Vec<Self>> {
        if let Self::Kept(node) = self {
            *self = Self::Array(node.elements()?.into_iter().map(Self::Kept).collect());
        }
        match self {
            Self::Array(elements) => Ok(elements),
            _ => Err(Error::malformed(Place::File, "a new value", "a list")),
        }
    }

    /// A member that is an object; created if missing.
    pub(super) fn child(&mut self, name: &str) -> Result<&mut Self> {
        let empty = || Self::Object(IndexMap::new());
        Ok(self.object()?.entry(name.to_owned()).or_insert_with(empty))
    }

    /// The elements of a member that is a list; created if missing.
    pub(super) fn list(&mut self, name: &str) -> Result<&mut Vec<Self>> {
        let empty = || Self::Array(Vec::new());
        self.object()?.entry(name.to_owned()).or_insert_with(empty).array()
    }

    /// An element of a member that is a list.
    pub(super) fn element(&mut self, name: &str, number: usize) -> Result<&mut Self> {
        let place = Place::Pointer(format!("/{name}/{number}"));
        let missing = || Error::malformed(place, "nothing", "an element of the list");
        self.list(name)?.get_mut(number).ok_or_else(missing)
    }

    /// Sets a value, and replaces one of the same name.
    pub(super) fn set(&mut self, name: &str, value: impl Into<Value>) -> Result<()> {
        self.object()?.insert(name.to_owned(), Self::New(value.into()));
        Ok(())
    }

    /// Removes a member.
    pub(super) fn remove(&mut self, name: &str) -> Result<()> {
        self.object()?.shift_remove(name);
        Ok(())
    }

    /// Removes a member if it is empty, because glTF does not allow empty lists.
    pub(super) fn remove_if_empty(&mut self, name: &str) -> Result<()> {
        let members = self.object()?;
        let is_empty = match members.get(name) {
            Some(Self::Object(left)) => left.is_empty(),
            Some(Self::Array(left)) => left.is_empty(),
            _ => false,
        };
        if is_empty {
            members.shift_remove(name);
        }
        Ok(())
    }

    /// Removes elements from a list by number, and the list if it becomes empty.
    pub(super) fn remove_elements(
        &mut self,
        name: &str,
        goes: impl Fn(usize) -> bool,
    ) -> Result<()> {
        let mut number = 0..;
        self.list(name)?.retain(|_| !number.next().is_some_and(&goes));
        self.remove_if_empty(name)
    }

    /// The text of the document.
    pub(super) fn text(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|error| {
            let found = format!("numbers that JSON cannot hold: {error}");
            Error::malformed(Place::File, found, "finite numbers")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn untouched_values_keep_their_text() {
        let text =
            r#" { "a" : [ 1.50 , { "z": 1,"b" :2 } , 2e1 ] , "b" : "x" , "d" : { "e" : -0.0 } } "#;
        let mut tree = Tree::Kept(Node::document(text).expect("JSON"));
        assert_eq!(tree.text().expect("text"), text.trim());
        tree.remove_elements("a", |i| i == 0).expect("a list");
        tree.child("n").and_then(|n| n.set("i", 7)).expect("an object");
        let edited = r#"{"a":[{ "z": 1,"b" :2 },2e1],"b":"x","d":{ "e" : -0.0 },"n":{"i":7}}"#;
        assert_eq!(tree.text().expect("text"), edited);
        tree.remove_elements("a", |_| true).expect("a list");
        tree.remove("n").expect("an object");
        assert_eq!(tree.text().expect("text"), r#"{"b":"x","d":{ "e" : -0.0 }}"#);
        assert!(tree.list("b").is_err() && tree.element("d", 0).is_err());
    }
}
