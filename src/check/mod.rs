//! Validation: all faults of a file, not only the first one.
//!
//! [`check`] detects a file's kind from its content. Containers and assets are checked by the rules
//! of strict readers. Inputs of a bake are opened as for a bake and then read once, plane by plane
//! ([`health`]). The result is a bounded list of findings; [`sarif`] is the same list for programs
//! that collect findings of many tools.

mod asset;
mod document;
mod file;
pub mod health;
mod input;
mod report;
pub mod sarif;

pub use file::{CheckOptions, check, check_file, check_with};
pub use report::{Report, ReportedFinding};
