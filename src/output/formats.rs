//! The formats of `export`.
//!
//! To add one: write a file or folder beside this one with a type that implements
//! [`ExportFormat`], and give it a row in [`FORMATS`]. The trait asks for
//!
//! 1. `check`, which refuses names and sizes before any work;
//! 2. `write`, which hands whole files to [`super::export_files::ExportFiles`] and lists what is
//!    lost;
//! 3. `read_back`, an own reader of the written bytes that renders by the format's own rules.
//!
//! `app/cli/export.rs` does the rest: names that are taken, pictures of both sides, the gate,
//! digests, the report. Options of one format alone are fields of
//! [`super::format::ExportOptions`], arguments there, and names in `options`.

use super::flipbook::Flipbook;
use super::format::ExportFormat;
use super::html::Html;
use super::snerg::Snerg;
use super::splat::Splat;
use super::usd::Usd;
use super::vdb::Vdb;

/// Every format, in the order of `--help`.
pub static FORMATS: [&dyn ExportFormat; 6] = [&Vdb, &Usd, &Snerg, &Flipbook, &Splat, &Html];

/// A format by its name.
pub fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}
