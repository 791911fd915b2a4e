//! Ranges of options that bakes and changes to a container share.

use std::fmt::Debug;

use crate::base::error::{Error, Result};
use crate::quantize::Bits;

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

/// The multiplier of a level rule's factor.
pub fn lod_scale(scale: f32) -> Result<()> {
    let fits = scale > 0.0 && scale.is_finite();
    Error::require_option(fits, "lod_scale", scale, "a number above 0")
}

/// Start of rays.
pub fn near(near: f32) -> Result<()> {
    let fits = near >= 0.0 && near.is_finite();
    require(fits, "near", near, "a distance of 0 or more")
}

/// Colour behind the field.
pub fn background(color: [f32; 3]) -> Result<()> {
    let fits = color.iter().all(|value| (0.0..=1.0).contains(value));
    require(fits, "background", color, "three numbers from 0 to 1")
}

/// The weight up to which samples add no colour.
pub fn color_threshold(least: f32) -> Result<()> {
    let fits = (0.0..1.0).contains(&least);
    require(fits, "color_threshold", least, "a weight from 0 to below 1")
}

fn require(fits: bool, option: &'static str, found: impl Debug, expected: &str) -> Result<()> {
    Error::require_option(fits, option, format!("{found:?}"), expected)
}
