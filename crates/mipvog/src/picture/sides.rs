//! Helpers that writers of pictures share.

use crate::base::error::{Error, ErrorKind, Place, Result};

/// Pixels along a side, at most.
pub const MOST_PIXELS: u64 = 1 << 16;
/// The sides of a picture, in bounds.
pub fn sides(width: usize, height: usize) -> Result<[u32; 2]> {
    let side = |size: usize| {
        u32::try_from(size).ok().filter(|&side| side > 0 && u64::from(side) <= MOST_PIXELS)
    };
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err(Error::invalid_option(
            "size",
            format!("{width}x{height}"),
            "sides of 1 to 65536 pixels",
        )),
    }
}

/// A picture that could not be made.
pub fn failed(message: String) -> Error {
    Error::new(ErrorKind::Io(std::io::Error::other(message)), Place::File)
}
