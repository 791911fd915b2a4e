//! The program as users and pipelines see it.

#[path = "../common/mod.rs"]
mod common;

mod assets;
mod call;
mod command_lines;
mod figures;
mod fit_cli;
mod forecast;
mod incremental;
mod manifest;
mod progress_cli;
mod remote;
mod render_cli;
mod transcode_cli;
mod trust;
mod view;
