//! Formats that other programs read, a file or a folder each.
//!
//! [`formats`] is the table of `export`; [`mod@format`] is the trait behind it. [`volume`] is a field's
//! level as the formats of volumes have it.

pub mod export_files;
pub mod flipbook;
pub mod format;
pub mod formats;
pub mod gltf;
pub mod html;
pub mod measure;
pub mod snerg;
pub mod splat;
pub mod usd;
pub mod vdb;
pub mod volume;
