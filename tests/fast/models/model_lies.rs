//! Lies in checkpoints of TensoRF, nerfstudio and DirectVoxGO: each has a typed error, in little
//! memory.

use crate::common::alone::{is_alone, measured};
use crate::common::factored::{dvgo, tensorf};
use crate::common::model_lies::LIES;
use crate::common::models::{is_typed, of_bytes, read};
use mipvog::base::error::Error;
use mipvog_inputs::SourceOptions;

/// Bytes that a small file may make the reader hold, whatever it states.
const MAX_MEMORY: usize = 16 << 20;

/// Opens and reads a file; the bytes that it took, and the outcome.
fn taken(bytes: Vec<u8>) -> (usize, Result<(), Error>) {
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    measured(|| of_bytes(bytes, &options).and_then(|source| read(&source)))
}

#[test]
fn lies_have_typed_errors() {
    if !is_alone(module_path!(), "lies_have_typed_errors") {
        return;
    }
    for (make, name, _, lie) in LIES {
        let mut file = make();
        lie(&mut file);
        let (held, outcome) = taken(file.to_bytes());
        let error = outcome.err().unwrap_or_else(|| panic!("{name} passes"));
        assert!(is_typed(&error), "{name}: {error}");
        assert!(held < MAX_MEMORY, "{name} takes {held} bytes");
    }
}

#[test]
fn every_prefix_has_a_typed_error() {
    if !is_alone(module_path!(), "every_prefix_has_a_typed_error") {
        return;
    }
    for bytes in [tensorf("MLP").to_bytes(), dvgo(true, true).to_bytes()] {
        for end in (0..bytes.len()).step_by(61) {
            let (held, outcome) = taken(bytes[..end].to_vec());
            let error = outcome.expect_err("a part of a file");
            assert!(is_typed(&error), "{end}: {error}");
            assert!(held < MAX_MEMORY, "{end} takes {held} bytes");
        }
    }
}
