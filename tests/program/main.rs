//! The program as users and pipelines see it.

/// What all tests share, and the program.
mod common {
    pub use mipvog_testing::*;

    pub const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");

    /// The program, with nothing in its environment but where `.ci/coverage` counts.
    pub fn program() -> std::process::Command {
        mipvog_testing::program(PROGRAM)
    }
}

mod assets;
mod bake_options;
mod blender;
mod call;
mod cameras;
mod command_lines;
mod compare;
mod containers;
mod figures;
mod forecast;
mod gltf;
mod guesses;
mod incremental;
mod manifest;
mod manifest_faults;
#[cfg(unix)]
mod manual;
mod merge;
mod mistakes;
mod models;
mod probe;
mod reading;
mod remote;
mod render_cli;
mod second_reader;
mod transcode_cli;
mod trust;
mod usd;
mod vdb;
mod verbs;
mod view;
mod view_fit;
