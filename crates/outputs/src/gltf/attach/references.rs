//! References to nodes and buffer views by number, everywhere in a document.
//!
//! Unknown extensions also refer to objects by number. By convention, such a property is named
//! after the kind of object, so every property of these names counts, at any depth.

use std::collections::{BTreeMap, BTreeSet};

use crate::base::error::Result;
use crate::gltf::asset::Asset;
use crate::gltf::asset::json::Node;

/// Properties with the number of a node, or of several nodes.
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
    /// Scans the whole document.
    pub fn of(asset: &Asset) -> Result<Self> {
        let mut found = Self::default();
        let mut add = |name: &str, value: &Node| found.property(name, value);
        for (name, value) in asset.document()?.members()? {
            match name.as_str() {
                "nodes" => value.visit(&mut add)?,
                // A scene's own list can be edited; references of its extensions cannot.
                "scenes" => {
                    for scene in value.elements().unwrap_or_default() {
                        let members = scene.members().unwrap_or_default();
                        for (name, value) in members.iter().filter(|(name, _)| *name != "nodes") {
                            add(name, value);
                            value.visit(&mut add)?;
                        }
                    }
                }
                _ => {
                    add(&name, &value);
                    value.visit(&mut add)?;
                }
            }
        }
        Ok(found)
    }

    fn property(&mut self, name: &str, value: &Node) {
        if NODES.contains(&name) {
            let several = value.elements().unwrap_or_default();
            let numbers = several.iter().chain([value]).filter_map(|node| node.index().ok());
            self.nodes.extend(numbers.map(|number| number as u64));
        }
        if name == "bufferView"
            && let Ok(view) = value.index()
        {
            *self.views.entry(view as u64).or_default() += 1;
        }
    }
}
