//! Pictures as files: 8-bit PNG and float32 EXR. The only door to `image` and `exr`.

use std::io::Cursor;

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, Text, WritableImage};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::error::{Error, ErrorKind, Place, Result};

/// A PNG of 8-bit grey (`values` one a pixel) or RGB (three a pixel), rows from the top.
pub fn png(width: usize, height: usize, values: &[u8]) -> Result<Vec<u8>> {
    let color = match values.len().checked_div(width * height) {
        Some(3) => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::L8,
    };
    let [w, h] = sides(width, height)?;
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(values, w, h, color)
        .map_err(|error| failed(error.to_string()))?;
    Ok(bytes)
}

/// An EXR of float32 channels, each with a value a pixel, rows from the top.
pub fn exr(width: usize, height: usize, channels: Vec<(String, Vec<f32>)>) -> Result<Vec<u8>> {
    sides(width, height)?;
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(Text::new_or_panic(&name), FlatSamples::F32(values)))
        .collect();
    let mut bytes = Cursor::new(Vec::new());
    Image::from_channels((width, height), AnyChannels::sort(channels))
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|error| failed(error.to_string()))?;
    Ok(bytes.into_inner())
}

fn sides(width: usize, height: usize) -> Result<[u32; 2]> {
    let side = |size: usize| u32::try_from(size).ok().filter(|&side| side > 0 && side <= 1 << 16);
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err(Error::usage(format!("no picture can be {width} x {height} pixels"))),
    }
}

fn failed(message: String) -> Error {
    Error::new(ErrorKind::Io(std::io::Error::other(message)), Place::File)
}
