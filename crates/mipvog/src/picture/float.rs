//! EXR.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, Text, WritableImage};

use super::sides::{failed, sides};
use super::{Channels, Samples, finite_half};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName};

/// An EXR of channels, each with one value per pixel, rows from the top.
pub fn exr(
    width: usize,
    height: usize,
    channels: Vec<(String, Vec<f32>)>,
    samples: Samples,
) -> Result<Vec<u8>> {
    sides(width, height)?;
    let stored = |values: Vec<f32>| match samples {
        Samples::Single => FlatSamples::F32(values),
        Samples::Half => FlatSamples::F16(values.into_iter().map(finite_half).collect()),
    };
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(Text::new_or_panic(&name), stored(values)))
        .collect();
    let mut bytes = Cursor::new(Vec::new());
    Image::from_channels((width, height), AnyChannels::sort(channels))
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|error| failed(error.to_string()))?;
    Ok(bytes.into_inner())
}

/// Reads an EXR of one flat layer, at most `max_bytes` of it as float32.
pub fn read_exr(path: &Path, max_bytes: u64) -> Result<Channels> {
    let unreadable = |error: exr::error::Error| {
        Error::malformed(Place::File, error.to_string(), "an EXR picture").in_file(path)
    };
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(unreadable)?;
    let values = meta.headers.iter().map(|header| {
        let pixels = header.layer_size.area() as u64;
        pixels.saturating_mul(4).saturating_mul(header.channels.list.len() as u64)
    });
    let bytes = values.fold(0u64, u64::saturating_add);
    limits::check(LimitName::Memory, "bytes of a picture", bytes, max_bytes, &Place::File)
        .map_err(|error| error.in_file(path))?;
    let image = exr::prelude::read_all_flat_layers_from_file(path).map_err(unreadable)?;
    let layer = image.layer_data.into_iter().next();
    let layer = layer.ok_or_else(|| failed("no layer in an EXR".to_owned()).in_file(path))?;
    let channel = |channel: AnyChannel<FlatSamples>| {
        let values = channel.sample_data.values_as_f32().collect();
        (channel.name.to_string(), values)
    };
    let channels = layer.channel_data.list.into_iter().map(channel).collect();
    Ok(Channels { width: layer.size.width(), height: layer.size.height(), channels })
}
