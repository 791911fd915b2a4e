//! The formats of `export`.
//!
//! To add one: write a type that implements [`ExportFormat`] in `crates/outputs`, and give it a row in
//! [`FORMATS`]. The trait asks for
//!
//! 1. `check`, which refuses names and sizes before any work;
//! 2. `write`, which hands whole files to [`mipvog_outputs::export_files::ExportFiles`] and lists what
//!    is lost;
//! 3. `read_back`, an own reader of the written bytes that renders by the format's own rules.
//!
//! `cli/export.rs` does the rest: names that are taken, pictures of both sides, the gate, digests, the
//! report. Options of one format alone are fields of [`mipvog_outputs::format::ExportOptions`],
//! arguments there, and names in `options`.

use mipvog_outputs::flipbook::Flipbook;
use mipvog_outputs::format::ExportFormat;
use mipvog_outputs::snerg::Snerg;
use mipvog_outputs::splat::Splat;
use mipvog_outputs::usd::Usd;
use mipvog_outputs::vdb::Vdb;

use crate::html::Html;

/// Every format, in the order of `--help`.
pub static FORMATS: [&dyn ExportFormat; 6] = [&Vdb, &Usd, &Snerg, &Flipbook, &Splat, &Html];

/// A format by its name.
pub fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}
