//! Radiance fields into glTF assets, and out of them again.
//!
//! Attaching changes these parts of a document and no other, in place ([`crate::output::gltf::asset::json`]):
//!
//! ```text
//! extensions.MIPVOG_radiance_field.radianceFields   + the field's properties
//! extensionsUsed                                    + the extension
//! nodes[i].extensions.MIPVOG_radiance_field         + {"radianceField": n}, on a node that is there,
//!                                                     or on a new one in the default scene
//! bufferViews, buffers[0].byteLength, chunk BIN     + the container, after all else (embedded only)
//! ```
//!
//! What cannot be told from the document later (an empty list that was there before, the length of a
//! buffer before its padding) goes into the field's `extras` as a [`record::Record`], so that
//! [`detach`] gives back what [`attach`] got. Detaching renumbers nothing but what attaching made:
//! somebody else's extension may refer to any other number.
//!
//! [`fallback`] makes a new asset of a mesh, for a field that has none.

mod fallback;
mod insert;
mod payloads;
mod record;
mod references;
mod remove;

pub use fallback::write_fallback;
pub use insert::{AttachOptions, Attached, NodeChoice, attach};
pub use remove::{Detached, detach};

use crate::base::bytes::Output;
use crate::base::error::Result;
use crate::output::gltf::asset::json::{Edits, List, Node};
use crate::output::gltf::asset::{Asset, Fields, Piece, uri, write_glb};

/// Where the container starts in the chunk BIN: its own chunks lie at multiples of this.
const ALIGNMENT: u64 = 64;

/// Files that the document names by relative URIs: they do not go with the asset to another folder.
pub fn companions(asset: &Asset) -> Result<Vec<String>> {
    let root = asset.document()?.members()?;
    let mut objects = Fields::read(asset, &root)?.objects;
    for list in ["buffers", "images"] {
        objects.extend(asset.list(&root, list)?);
    }
    let mut names = Vec::new();
    for object in objects {
        if let Some(found) = object.get("uri")? {
            let name: String = found.parse("a URI")?;
            names.extend((!uri::is_data(&name) && !name.contains("://")).then_some(name));
        }
    }
    Ok(names)
}

/// Writes an edited asset as the kind that it is: in a GLB `bin` is the new chunk BIN, other chunks stay.
fn write_edited(asset: &Asset, edits: Edits, bin: &[Piece], output: &mut Output) -> Result<()> {
    let text = edits.apply(asset.text());
    match asset.chunks() {
        Some(chunks) => {
            let others = asset.file().part(chunks.others.clone())?;
            write_glb(&text, bin, Some(&others), output)
        }
        None => output.append(text.as_bytes()),
    }
}

/// A list of a document's root, if it is there.
fn list_of<'a>(parent: &List<'a>, name: &str) -> Result<Option<List<'a>>> {
    parent.get(name).map(Node::elements).transpose()
}
