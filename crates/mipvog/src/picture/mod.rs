//! Pictures as files: 8-bit PNG and JPEG, and float32 EXR. The only users of `image`, `imagesize`
//! and `exr`, which need the feature `pictures`.

#[cfg(feature = "pictures")]
mod eight_bit;
#[cfg(feature = "pictures")]
mod float;
#[cfg(feature = "pictures")]
mod sides;
#[cfg(not(feature = "pictures"))]
mod without;

#[cfg(feature = "pictures")]
pub use eight_bit::{decode, png, read, size};
#[cfg(feature = "pictures")]
pub use float::{exr, read_exr};
use half::f16;
#[cfg(not(feature = "pictures"))]
pub use without::{read, size};

/// A picture file as 8-bit RGBA, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rgba {
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Four bytes per pixel, alpha not premultiplied.
    pub bytes: Vec<u8>,
}

/// The samples of an EXR.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// float32.
    Single,
    /// float16; larger values are clamped to its largest.
    Half,
}

/// Channels of an EXR file.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names, and one value per pixel, rows from the top.
    pub channels: Vec<(String, Vec<f32>)>,
}

/// The nearest half float that is finite.
pub fn finite_half(value: f32) -> f16 {
    f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

/// Means of `factor` by `factor` pixels of a picture `width` by `height`, rows from the top; the
/// remainder at the right and below is dropped. `value` gives a pixel's value by its number.
pub fn box_means<'a>(
    [width, height]: [usize; 2],
    factor: usize,
    value: impl Fn(usize) -> f32 + 'a,
) -> impl Iterator<Item = f32> + 'a {
    let (across, down) = (width / factor, height / factor);
    (0..across * down).map(move |i| {
        let (x, y) = (i % across * factor, i / across * factor);
        let rows = (y..y + factor).map(|row| row * width + x);
        let pixels = rows.flat_map(|start| start..start + factor);
        let sum: f64 = pixels.map(|pixel| f64::from(value(pixel))).sum();
        (sum / (factor * factor) as f64) as f32
    })
}
