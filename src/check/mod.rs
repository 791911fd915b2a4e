//! Validation: all faults of a file, not only the first one.
//!
//! [`check`] tells a file's kind by its content. Containers and assets are walked by the rules that
//! strict readers use. Inputs of a bake are opened as a bake opens them and then read once, plane
//! by plane ([`health`]). The result is a bounded list of findings; [`sarif`] is the same list for
//! programs that gather findings of many tools.

mod asset;
mod document;
mod file;
pub mod health;
mod input;
mod report;
pub mod sarif;

pub use file::{CheckOptions, check, check_file, check_with};
pub use report::{Report, ReportedFinding};
