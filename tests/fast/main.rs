//! Tests within this process: of the library, and of the pages and folders of the repository.

use mipvog_testing as common;
use peak_alloc::PeakAlloc;

/// Counts what tests hold that run alone.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Of many cases by chance one in so many is tried. `tests/slow` tries all.
const ONE_IN: usize = 11;

mod bake;
mod broken;
mod container;
mod front_doors;
mod frozen;
mod fuzz;
mod golden;
mod layers;
mod links;
mod models;
mod oracle;
mod output;
mod render;
mod roundtrip;
mod spec;
