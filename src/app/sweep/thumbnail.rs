//! Small pictures for the page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};

use crate::base::error::Result;
use crate::base::picture;
use crate::view::compare::{FrameErrors, Picture};

/// Pixels along a side, at most.
const LARGEST_SIDE: usize = 160;

/// A frame as it should look and as it looks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thumbnail {
    /// The camera's name.
    pub frame: String,
    /// Pixels of the full picture along one of the compared one.
    pub scale: usize,
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What should be seen: a PNG in base64.
    pub want: String,
    /// What is seen, likewise.
    pub got: String,
}

impl Thumbnail {
    /// Shrinks a frame by a whole number, if it is too large.
    pub fn of(frame: &FrameErrors) -> Result<Self> {
        let side = frame.got.width.max(frame.got.height);
        // A long and narrow picture keeps its one pixel.
        let most = frame.got.width.min(frame.got.height).max(1);
        let factor = side.div_ceil(LARGEST_SIDE).clamp(1, most);
        let (want, got) = (frame.want.downsampled(factor), frame.got.downsampled(factor));
        Ok(Self {
            frame: frame.frame.to_owned(),
            scale: frame.scale,
            width: got.width,
            height: got.height,
            want: encode(&want)?,
            got: encode(&got)?,
        })
    }
}

fn encode(picture: &Picture) -> Result<String> {
    // As training wrote pictures: times 255, rounded to nearest.
    let byte = |value: &f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let bytes: Vec<u8> = picture.color.as_flattened().iter().map(byte).collect();
    Ok(STANDARD.encode(picture::png(picture.width, picture.height, &bytes)?))
}
