//! Tests that take long. `cargo test` leaves them out; `.ci/run` runs most of them, and `.ci/night` all.

use peak_alloc::PeakAlloc;

/// Counts what tests hold that run alone.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What all tests share, and the program.
mod common {
    pub use mipvog_testing::*;

    pub const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");

    /// The program, with nothing in its environment but where `.ci/coverage` counts.
    pub fn program() -> std::process::Command {
        mipvog_testing::program(PROGRAM)
    }
}

/// Of many cases by chance, all are tried: those of files of `tests/fast`, too.
const ONE_IN: usize = 1;

#[path = "../fast/output/attach.rs"]
mod attach;
mod every_family;
mod export;
mod export_pages;
#[cfg(unix)]
mod faults;
mod fit;
mod fit_cli;
mod fuzz;
mod gltf_tools;
#[cfg(unix)]
mod interrupt;
#[cfg(unix)]
mod manual;
#[path = "../fast/bake/max_error.rs"]
mod max_error;
#[cfg(target_os = "linux")]
mod memory;
mod numerics;
#[cfg(unix)]
mod paused;
mod progress_cli;
#[path = "../fast/output/random_scenes.rs"]
mod random_scenes;
#[path = "../fast/output/render_plain.rs"]
mod render_plain;
mod splat;
#[path = "../fast/models/tensor.rs"]
mod tensor;
mod transcode;
