//! A few mutants for each fuzz target, and files that ask for much memory. `tests/slow/fuzz.rs` has
//! many mutants.

use std::sync::Arc;

use crate::common::alone::{is_alone, measured};
use crate::common::fuzz::{MAX_MEMORY, hostile_files};
use mipvog::base::bytes::SourceFile;
use mipvog::base::limits::Limits;
use mipvog_bake::check::{CheckOptions, check_file};

mipvog_testing::tests_of_targets! { 200, 1 }

#[test]
fn hostile_files_take_little_memory() {
    if !is_alone(module_path!(), "hostile_files_take_little_memory") {
        return;
    }
    for (name, bytes) in hostile_files() {
        let length = bytes.len();
        let file = Arc::new(SourceFile::decoded(bytes, &name));
        let check = || check_file(file, &CheckOptions::default(), &Limits::default());
        let (held, report) = measured(check);
        assert!(!report.expect("readable").valid, "{}", name.display());
        assert!(held < MAX_MEMORY + length, "{} takes {held} bytes", name.display());
    }
}
