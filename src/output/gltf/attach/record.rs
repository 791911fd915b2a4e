//! What a document does not tell about its own past.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::base::error::Result;
use crate::output::gltf::asset::json::{Edits, Node};

/// The key in a field's `extras`.
const KEY: &str = "attached";

/// What attaching a field found and made. Left out where it is nothing out of the ordinary.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Record {
    /// Whether the field's node was made for it.
    #[serde(skip_serializing_if = "is_false")]
    pub node: bool,
    /// Whether the scene was made too.
    #[serde(skip_serializing_if = "is_false")]
    pub scene: bool,
    /// Lists and objects that were there, but empty, and `extensionsUsed.own` where the extension was
    /// listed without any field.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub found: BTreeSet<String>,
    /// Bytes of the buffer, where they did not end right before the container.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub byte_length: Option<u64>,
    /// Bytes of the chunk BIN, where they were not those of the buffer and its padding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chunk_length: Option<u64>,
}

fn is_false(value: &bool) -> bool {
    !value
}

impl Record {
    /// The record of a field, if its `extras` hold one.
    pub fn of(field: &Node) -> Result<Self> {
        let extras = field.get("extras")?;
        // Extras can be anything; what is not ours is nobody's record.
        let object = extras.and_then(|extras| extras.get(KEY).ok().flatten());
        object.map_or(Ok(Self::default()), |record| record.parse("what attaching recorded"))
    }

    /// As a member of the field's object, with the comma before it; nothing where there is nothing to
    /// record.
    pub fn member(&self) -> String {
        if *self == Self::default() {
            return String::new();
        }
        format!(",\"extras\":{{{}}}", self.own_member())
    }

    fn own_member(&self) -> String {
        // A map of plain values is always JSON.
        let text = serde_json::to_string(self).unwrap_or_default();
        format!("\"{KEY}\":{text}")
    }

    /// Puts this record in the place of the one that a field has.
    pub fn replace(&self, field: &Node, edits: &mut Edits) -> Result<()> {
        if *self == Self::of(field)? {
            return Ok(());
        }
        let members = field.members()?;
        let empty = *self == Self::default();
        let Some(extras) = members.get("extras") else {
            edits.append(&members, self.member().trim_start_matches(','));
            return Ok(());
        };
        let own = extras.members()?;
        match own.get(KEY) {
            Some(_) if empty && own.len() == 1 => edits.remove_member(&members, "extras"),
            Some(_) if empty => edits.remove_member(&own, KEY),
            Some(record) => {
                edits.replace(record, serde_json::to_string(self).unwrap_or_default());
            }
            None => edits.append(&own, &self.own_member()),
        }
        Ok(())
    }

    /// Takes over what a field that goes away had recorded about the document.
    pub fn absorb(&mut self, gone: &Self) {
        self.scene |= gone.scene;
        self.found.extend(gone.found.iter().filter(|name| !name.starts_with("node.")).cloned());
    }
}
