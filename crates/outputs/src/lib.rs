//! Writes the formats of other programs, one file or folder per format.
//!
//! [`mod@format`] has the trait for formats of `export`. [`volume`] represents one level of a field
//! for volume formats.

use mipvog::{base, container, levels, model, picture, unpacked, view};

#[doc(hidden)]
pub mod export_files;
#[doc(hidden)]
pub mod flipbook;
#[doc(hidden)]
pub mod format;
#[doc(hidden)]
pub mod gltf;
#[doc(hidden)]
pub mod measure;
#[doc(hidden)]
pub mod snerg;
#[doc(hidden)]
pub mod splat;
#[doc(hidden)]
pub mod unpack;
#[doc(hidden)]
pub mod usd;
#[doc(hidden)]
pub mod vdb;
#[doc(hidden)]
pub mod volume;
