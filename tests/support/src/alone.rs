//! Tests that count what a whole process takes.

use std::process::Command;

use peak_alloc::PeakAlloc;

/// Set in the process of a test that runs alone.
const ALONE: &str = "MIPVOG_TEST_ALONE";

/// Runs a test, of a `module_path!()`, in a process of its own, in which other tests allocate
/// nothing; true there, false in the process that waited for it.
///
/// # Panics
///
/// The test fails there.
pub fn is_alone(module: &str, test: &str) -> bool {
    if std::env::var_os(ALONE).is_some() {
        return true;
    }
    let module = module.split_once("::").map_or("", |(_, within)| within);
    let test = format!("{module}::{test}");
    let mut own = Command::new(std::env::current_exe().expect("a program"));
    let ran =
        own.args([&test[..], "--exact", "--nocapture"]).env(ALONE, "").output().expect("starts");
    let said = String::from_utf8_lossy(&ran.stdout);
    let errors = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success() && said.contains("1 passed"), "{said}\n{errors}");
    false
}

/// Bytes that `work` held beyond what there was before, at most, and its result. Programs that ask
/// have [`PeakAlloc`] as their allocator.
pub fn measured<T>(work: impl FnOnce() -> T) -> (usize, T) {
    PeakAlloc.reset_peak_usage();
    let before = PeakAlloc.current_usage();
    let result = work();
    (PeakAlloc.peak_usage().saturating_sub(before), result)
}
