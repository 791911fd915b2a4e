//! The formats of `export`.
//!
//! To add one: write a type that implements [`ExportFormat`] in `crates/outputs`, and give it a row
//! in [`FORMATS`]. The trait asks for
//!
//! 1. `check`, which refuses names and sizes before any work;
//! 2. `write`, which hands whole files to [`mipvog_outputs::export_files::ExportFiles`] and lists
//!    what is lost;
//! 3. `read_back`, a separate reader of the written bytes that renders by the format's own rules.
//!
//! `cli/export.rs` does the rest: refusing existing files, pictures of both sides, the gate,
//! digests, the report. Options of a single format are fields of
//! [`mipvog_outputs::format::ExportOptions`], arguments in that file, and names in `options`.

use std::path::Path;

use mipvog_outputs::flipbook::Flipbook;
use mipvog_outputs::format::ExportFormat;
use mipvog_outputs::gltf::mesh_file::Glb;
use mipvog_outputs::snerg::Snerg;
use mipvog_outputs::splat::Splat;
use mipvog_outputs::usd::Usd;
use mipvog_outputs::vdb::Vdb;

use crate::base::error::{Error, Result};
use crate::html::Html;

/// Every format, in the order of `--help`.
pub static FORMATS: [&dyn ExportFormat; 7] = [&Vdb, &Usd, &Glb, &Html, &Splat, &Flipbook, &Snerg];

/// Alternative names and extensions of outputs, by format.
const OTHER_NAMES: [(&str, &str); 13] = [
    ("openvdb", "vdb"),
    ("usda", "usd"),
    ("usdc", "usd"),
    ("gltf", "glb"),
    ("mesh", "glb"),
    ("htm", "html"),
    ("page", "html"),
    ("ply", "splat"),
    ("spz", "splat"),
    ("splats", "splat"),
    ("png", "flipbook"),
    ("exr", "flipbook"),
    ("sprites", "flipbook"),
];

/// Those of the names above that are one of a format's kinds of files: the output must have this
/// extension.
const KINDS: [&str; 4] = ["ply", "spz", "png", "exr"];

/// Extensions of meshes in formats that are not written.
const MESHES: [&str; 4] = ["dae", "fbx", "obj", "stl"];

/// The remedy for them.
pub const OF_MESHES: &str = "write a mesh as .glb; other programs convert it";

/// True for the extension of a mesh in a format that is not written.
pub fn is_mesh(extension: &str) -> bool {
    MESHES.contains(&&*extension.to_lowercase())
}

/// Other names of a format.
pub fn other_names(format: &str) -> impl Iterator<Item = &'static str> {
    OTHER_NAMES.into_iter().filter(move |(_, own)| *own == format).map(|(other, _)| other)
}

/// The format for an output's extension.
fn format_of_extension(extension: &str) -> Option<&'static dyn ExportFormat> {
    let other = OTHER_NAMES.into_iter().find(|(other, _)| *other == extension);
    format_named(other.map_or(extension, |(_, own)| own))
}

/// A format by its name.
fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}

/// The format of an export, by its name or by the extension of the output.
///
/// # Errors
/// `Usage` if neither names one.
pub fn format_of(name: Option<&str>, output: &Path) -> Result<&'static dyn ExportFormat> {
    let extension = output.extension().and_then(|extension| extension.to_str());
    if let Some(kind) = name.filter(|name| KINDS.contains(name) && extension != Some(*name)) {
        let message = format!("--to {kind}, but -o {}: end it in .{kind}", output.display());
        return Err(Error::usage(message));
    }
    let found = match (name, extension) {
        (Some(name), _) => format_named(name).or_else(|| format_of_extension(name)),
        (None, Some(extension)) => format_of_extension(&extension.to_lowercase()),
        (None, None) => None,
    };
    // These write a folder under any other name.
    if let (Some(own), Some(extension)) = (found, extension)
        && ["html", "snerg"].contains(&own.name())
        && format_of_extension(extension).is_some_and(|other| other.name() != own.name())
    {
        let message = format!("--to {}, but -o {}", own.name(), output.display());
        return Err(Error::usage(message).advise("leave out --to, or name a folder"));
    }
    found.ok_or_else(|| {
        let names = FORMATS.map(|format| format.name()).join(", ");
        let message = format!("-o {}: the name does not say the format", output.display());
        Error::usage(message).advise(match extension.is_some_and(is_mesh) {
            true => OF_MESHES.to_owned(),
            false => format!("pass --to with one of {names}; html and snerg write folders"),
        })
    })
}
