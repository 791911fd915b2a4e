//! Small pictures of a setting: its rendering, and its errors.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};

use crate::base::error::Result;
use crate::picture::{box_means, png};
use crate::report_page::{FULL_HEAT, bytes_of};
use crate::view::compare::{FrameErrors, Picture};

/// Approximate width of each of the two pictures in pixels.
const WIDTH: usize = 128;

/// The field's picture, and to its right the errors of its pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thumbnail {
    /// Pixels along a row and rows, of both together.
    pub size: [usize; 2],
    /// The file. Text formats hold it in base64.
    #[serde(serialize_with = "to_base64", deserialize_with = "from_base64")]
    pub png: Vec<u8>,
}

impl Thumbnail {
    /// Of a frame.
    ///
    /// # Errors
    ///
    /// Errors of writing a PNG.
    pub(super) fn of(frame: &FrameErrors) -> Result<Self> {
        let (want, got) = (shrunk(frame.want), shrunk(frame.got));
        let (width, height) = (got.width, got.height);
        let colors = bytes_of(&got.color);
        let heat = want.heat_map(&got, FULL_HEAT);
        let rows = colors.chunks_exact(3 * width).zip(heat.chunks_exact(3 * width));
        let pixels: Vec<u8> = rows.flat_map(|(own, error)| [own, error].concat()).collect();
        Ok(Self { size: [2 * width, height], png: png(2 * width, height, &pixels)? })
    }
}

/// A picture of about [`WIDTH`] pixels a row.
fn shrunk(picture: &Picture) -> Picture {
    let size = [picture.width, picture.height];
    let most = size.into_iter().min().unwrap_or(1).max(1);
    let factor = picture.width.div_ceil(WIDTH).clamp(1, most);
    let channel = |channel: usize| box_means(size, factor, move |i| picture.color[i][channel]);
    let color = channel(0).zip(channel(1)).zip(channel(2)).map(|((r, g), b)| [r, g, b]);
    Picture {
        width: picture.width / factor,
        height: picture.height / factor,
        color: color.collect(),
        diffuse: None,
        opacity: None,
        level: None,
    }
}

fn to_base64<S: serde::Serializer>(bytes: &[u8], to: S) -> std::result::Result<S::Ok, S::Error> {
    to.serialize_str(&STANDARD.encode(bytes))
}

fn from_base64<'de, D: serde::Deserializer<'de>>(
    from: D,
) -> std::result::Result<Vec<u8>, D::Error> {
    let text = String::deserialize(from)?;
    STANDARD.decode(text).map_err(serde::de::Error::custom)
}
