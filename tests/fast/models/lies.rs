//! Kinds of errors that lies in files end in.

use mipvog::base::error::{Error, ErrorKind};

/// The file is not what its format says.
pub fn malformed(error: Error, says: &str) {
    assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
    assert!(error.to_string().contains(says), "{error} does not say {says}");
}

/// The file may be sound, but this program does not take it.
pub fn unsupported(error: Error, says: &str) {
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains(says), "{error} does not say {says}");
}
