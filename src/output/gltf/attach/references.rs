//! Numbers of nodes and buffer views, at every place of a document that refers to them.
//!
//! Unknown extensions refer to things by number too. By convention such a property is named after
//! the thing it refers to, so every property of these names counts, at any depth.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::base::error::Result;
use crate::output::gltf::asset::Asset;

/// Properties that hold the number of a node, or several.
const NODES: [&str; 6] = ["node", "nodes", "children", "joints", "skeleton", "rootNodes"];

/// References of a document.
#[derive(Debug, Default)]
pub struct References {
    /// Nodes that something other than a scene refers to.
    pub nodes: BTreeSet<u64>,
    /// Number of references to each buffer view.
    pub views: BTreeMap<u64, usize>,
}

impl References {
    /// Goes through the whole document.
    pub fn of(asset: &Asset) -> Result<Self> {
        let mut found = Self::default();
        let root: serde_json::Map<String, Value> = asset.document()?.parse("an object")?;
        for (name, value) in &root {
            match (name.as_str(), value) {
                ("nodes", Value::Array(nodes)) => nodes.iter().for_each(|node| found.visit(node)),
                // A scene's own list can be edited; references of its extensions cannot.
                ("scenes", Value::Array(scenes)) => {
                    let members = scenes.iter().filter_map(Value::as_object).flatten();
                    members
                        .filter(|(name, _)| *name != "nodes")
                        .for_each(|(name, value)| found.property(name, value));
                }
                (name, value) => found.property(name, value),
            }
        }
        Ok(found)
    }

    fn visit(&mut self, value: &Value) {
        match value {
            Value::Object(members) => {
                members.iter().for_each(|(name, value)| self.property(name, value));
            }
            Value::Array(elements) => elements.iter().for_each(|element| self.visit(element)),
            _ => {}
        }
    }

    fn property(&mut self, name: &str, value: &Value) {
        if NODES.contains(&name) {
            let several = value.as_array().into_iter().flatten();
            self.nodes.extend(several.chain([value]).filter_map(Value::as_u64));
        }
        if let ("bufferView", Some(view)) = (name, value.as_u64()) {
            *self.views.entry(view).or_default() += 1;
        }
        self.visit(value);
    }
}
