//! The parts of glTF 2.0 assets, `.glb` and `.gltf`, that radiance fields need: chunks, the JSON
//! document as text, and the extension `MIPVOG_radiance_field`
//! (`formats/MIPVOG_radiance_field/README.md`).
//!
//! ```text
//! GLB:  magic "glTF", version 2, length; then chunks: length, type, bytes, each a multiple of 4
//!       JSON, padded with spaces     BIN, padded with zeros, optional     others, kept as they are
//! ```
//!
//! [`glb`] has the chunks, [`json`] values in place and edits of the text, [`uri`] the files that
//! URIs name, [`properties`] the extension's objects, [`fields`] the fields of a document and the
//! containers that they name, [`rules`] the rules for them.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod document;
mod fields;
mod glb;
pub mod json;
pub mod properties;
pub mod rules;
pub mod uri;

pub use document::{Asset, EXTENSION, is_asset};
pub use fields::{ContainerBytes, Fields, buffer_is_chunk, container_bytes, one_of};
pub use glb::{Chunks, Piece, padded, write_glb};
