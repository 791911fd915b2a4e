//! Ranges of options that bakes and changes to a container share.

use crate::base::error::{Error, Result};
use crate::codec::quantize::Bits;

/// Bits of a code.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`], as of the other rules.
pub fn bits(bits: Bits) -> Result<()> {
    let fits = match bits {
        Bits::Integer(bits) => (4..=16).contains(&bits),
        Bits::F16 | Bits::F32 => true,
    };
    Error::require_option(fits, "bits", bits, "4 to 16, f16 or f32")
}

/// Levels in all, at most.
pub fn levels(levels: usize) -> Result<()> {
    Error::require_option(levels >= 1, "levels", levels, "at least 1")
}

/// Compression level of zstd.
pub fn zstd_level(level: i32) -> Result<()> {
    Error::require_option((1..=22).contains(&level), "zstd_level", level, "1 to 22")
}

/// The number that multiplies the factor of a rule of levels.
pub fn lod_scale(scale: f32) -> Result<()> {
    let fits = scale > 0.0 && scale.is_finite();
    Error::require_option(fits, "lod_scale", scale, "a number above 0")
}
