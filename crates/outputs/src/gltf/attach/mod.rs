//! Attaches radiance fields to glTF assets, and detaches them.
//!
//! Attaching changes these parts of a document:
//!
//! ```text
//! extensions.MIPVOG_radiance_field.radianceFields   + the field's properties
//! extensionsUsed                                    + the extension
//! nodes[i].extensions.MIPVOG_radiance_field         + {"radianceField": n}, on a node that is
//!                                                     there, or on a new one in the default scene
//! bufferViews, buffers[0].byteLength, chunk BIN     + the container, after all else
//!                                                     (embedded only)
//! ```
//!
//! All other values keep their text ([`tree`]). [`detach`] takes these parts out again. For this,
//! the field's `extras` ([`notes`]) state the nodes and the scene that were made for it, and the
//! length of the buffer before its padding. Lists and objects that become empty are removed too,
//! because glTF does not allow empty lists. Detaching renumbers only the parts that attaching made,
//! because other extensions may refer to any other number.
//!
//! [`write_fallback`] makes a new asset with a mesh, for a field without an asset.

mod containers;
mod fallback;
mod insert;
mod notes;
mod references;
mod remove;
mod tree;
mod write;

pub use fallback::{write_fallback, write_mesh};
pub use insert::{AttachOptions, Attached, NodeChoice, attach};
pub use remove::{Detached, detach};
pub use write::{companion_paths, companions};
