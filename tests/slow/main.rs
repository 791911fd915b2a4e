//! Tests that take long. `cargo test` leaves them out; the gate runs `cargo test --test slow`.

use peak_alloc::PeakAlloc;

/// Counts what tests hold that run alone.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What all tests share, and the program.
mod common {
    pub use mipvog_testing::*;

    #[cfg(feature = "cli")]
    pub const PROGRAM: &str = env!("CARGO_BIN_EXE_mipvog-bake");

    /// The program, with nothing in its environment but where `.ci/coverage` counts.
    #[cfg(feature = "cli")]
    pub fn program() -> std::process::Command {
        mipvog_testing::program(PROGRAM)
    }
}

/// Of many cases by chance, all are tried: those of files of `tests/fast`, too.
const ONE_IN: usize = 1;

#[path = "../fast/output/attach.rs"]
mod attach;
mod every_family;
#[cfg(feature = "cli")]
mod export;
#[cfg(feature = "cli")]
mod export_pages;
#[cfg(all(feature = "cli", unix))]
mod faults;
mod fit;
#[cfg(feature = "cli")]
mod fit_cli;
mod fuzz;
#[cfg(feature = "cli")]
mod gltf_tools;
#[cfg(all(feature = "cli", unix))]
mod interrupt;
#[cfg(all(feature = "cli", unix))]
mod manual;
#[path = "../fast/bake/max_error.rs"]
mod max_error;
#[cfg(all(feature = "cli", target_os = "linux"))]
mod memory;
mod numerics;
#[cfg(all(feature = "cli", unix))]
mod paused;
#[cfg(feature = "cli")]
mod progress_cli;
#[path = "../fast/output/render_plain.rs"]
mod render_plain;
#[cfg(feature = "cli")]
mod splat;
#[path = "../fast/models/tensor.rs"]
mod tensor;
mod transcode;
