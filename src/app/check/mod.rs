//! Validation: everything that is wrong with a file, not only the first thing.
//!
//! [`check`] tells by content what a file is. Containers and assets are walked by the rules that
//! strict readers use; inputs of a bake are opened as a bake opens them and then read once, plane
//! by plane ([`health`]). What is kept of it all is a bounded list of findings; [`sarif`] is the
//! same list for programs that gather findings of many tools.

mod asset;
mod file;
pub mod health;
mod input;
mod report;
pub mod sarif;

pub use file::{CheckOptions, check, check_file, check_with};
pub use report::{Report, ReportedFinding};
