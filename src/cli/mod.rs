//! The command line: arguments in, reports on stdout, progress and warnings on stderr.
//!
//! There is one file per verb. Verbs return their reports; printing and exit codes are here.

mod animation;
mod attach;
mod bake;
mod call;
mod cameras;
mod common;
mod compare;
mod compare_page;
mod container_report;
mod destination;
mod detach;
mod detail;
mod document;
mod error_report;
mod export;
mod export_report;
mod export_source;
mod failure;
mod field;
mod file_names;
mod files;
mod fit;
mod gate;
mod gltf;
mod guess;
mod help;
mod incremental;
mod inputs;
mod inspect;
mod interrupt;
mod junit;
mod layout;
mod manifest;
mod open;
mod outcome;
mod output;
mod paint;
mod picture;
mod pictures;
mod placement;
mod plan;
mod probe;
mod program;
mod progress;
mod python_options;
mod render;
mod report;
mod scene;
#[cfg(feature = "schemas")]
mod schemas;
mod settings;
mod shell;
mod stdin;
mod stored;
mod sweep;
mod sweep_command;
mod thumbnail;
mod transcode;
mod unpack;
mod validate;
mod values;
mod view;
mod view_report;
mod viewpoints;
mod warnings;
mod watcher;

pub use call::{Call, Failure};
pub use open::OpenField;
pub use program::{call, main, main_of, option_names};
pub use python_options::python_options;
#[cfg(feature = "schemas")]
pub use schemas::{schemas, text as schema_text};
pub use view_report::ColorFit;
pub use watcher::{SharedWatcher, Watcher};
