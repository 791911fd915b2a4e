//! Notes in a field's `extras`: the parts of a document that attaching made.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::tree::Tree;
use crate::base::error::Result;
use crate::gltf::asset::json::Node;

/// The key in a field's `extras`.
const KEY: &str = "attached";

/// The parts that attaching a field made. Omitted if empty.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Notes {
    /// True if the field's node was made for it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) node: bool,
    /// True if the scene was made too.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) scene: bool,
    /// Bytes of the buffer, unless they ended right before the container.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) byte_length: Option<u64>,
}

impl Notes {
    /// The notes of a field; none if its `extras` have no notes.
    pub(super) fn of(field: &Node) -> Result<Self> {
        let extras = field.get("extras")?;
        let own = extras.and_then(|extras| extras.get(KEY).ok().flatten());
        own.map_or(Ok(Self::default()), |notes| notes.parse("what attaching noted"))
    }

    /// Adds them to the properties of a new field.
    pub(super) fn add_to(&self, field: &mut Value) {
        if *self != Self::default() {
            field["extras"] = json!({ KEY: self });
        }
    }

    /// Replaces the notes of a field.
    pub(super) fn store(&self, field: &mut Tree) -> Result<()> {
        let extras = field.child("extras")?;
        match *self == Self::default() {
            true => extras.remove(KEY)?,
            false => extras.set(KEY, json!(self))?,
        }
        field.remove_if_empty("extras")
    }
}
