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

mod every_family;
#[cfg(all(feature = "cli", unix))]
mod faults;
mod fuzz;
#[cfg(all(feature = "cli", unix))]
mod interrupt;
#[cfg(all(feature = "cli", target_os = "linux"))]
mod memory;
