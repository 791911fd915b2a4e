//! Pictures in a build without them.

use std::path::Path;

use super::Rgba;
use crate::base::error::{Error, Place, Result};

fn left_out(path: &Path) -> Error {
    let expected = "a build of the crate `mipvog` with the feature `pictures`";
    Error::unsupported(Place::File, "a picture", expected).in_file(path)
}

/// Width and height of a picture file.
///
/// # Errors
///
/// `Unsupported`.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    Err(left_out(path))
}

/// Reads a picture.
///
/// # Errors
///
/// `Unsupported`.
pub fn read(path: &Path, _: u64) -> Result<Rgba> {
    Err(left_out(path))
}
