//! Animated WebP files, lossless: [`image_webp`] codes each frame, and the container around the
//! frames is written here (RFC 9649, section 2.7).

use std::path::{Path, PathBuf};

use image_webp::{ColorType, WebPEncoder};

use super::format::FilmOptions;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Result};

/// Bytes before the first chunk: `RIFF`, the length of what follows, and `WEBP`.
const HEADER: usize = 12;
/// Bits of the file's flags.
const ANIMATED: u8 = 0x02;
const WITH_ALPHA: u8 = 0x10;
/// A frame replaces the one before it, and is not blended with it.
const REPLACES: u8 = 0x02;

/// A WebP that repeats forever.
pub struct WebpFilm {
    output: Output,
    path: PathBuf,
    options: FilmOptions,
    /// Frames so far.
    frames: usize,
}

impl WebpFilm {
    pub fn start(mut output: Output, path: &Path, options: FilmOptions) -> Result<Self> {
        output.append(b"RIFF\0\0\0\0WEBP")?;
        let flags = ANIMATED | if options.alpha { WITH_ALPHA } else { 0 };
        let canvas = [&[flags, 0, 0, 0][..], &size(options.size)].concat();
        append_chunk(&mut output, b"VP8X", &canvas)?;
        // The background colour, and infinite repetitions.
        append_chunk(&mut output, b"ANIM", &[0; 6])?;
        Ok(Self { output, path: path.to_owned(), options, frames: 0 })
    }

    pub fn add(&mut self, values: &[u8]) -> Result<()> {
        let [width, height] = self.options.size;
        let color = if self.options.alpha { ColorType::Rgba8 } else { ColorType::Rgb8 };
        let mut still = Vec::new();
        WebPEncoder::new(&mut still)
            .encode(values, width as u32, height as u32, color)
            .map_err(|error| Error::io(std::io::Error::other(error.to_string()), &self.path))?;
        let milliseconds = self.options.delay(self.frames, 1000.0);
        self.frames += 1;
        // Its upper left corner, size and time, and the chunk of a still picture.
        let mut frame = vec![0; 6];
        frame.extend(size(self.options.size));
        frame.extend(three_bytes(milliseconds));
        frame.push(REPLACES);
        frame.extend(still.get(HEADER..).unwrap_or_default());
        append_chunk(&mut self.output, b"ANMF", &frame)
    }

    pub fn finish(mut self) -> Result<()> {
        let length = self.output.length() - 8;
        let length = u32::try_from(length).map_err(|_| {
            let message =
                "a WebP file of 4 GiB or more: render fewer or smaller frames, or a video";
            Error::io(std::io::Error::other(message), &self.path)
        })?;
        self.output.patch(4, &length.to_le_bytes())?;
        self.output.finish()
    }
}

/// Width and height minus one, as in the format.
fn size(sides: [usize; 2]) -> [u8; 6] {
    let [[a, b, c], [d, e, f]] = sides.map(|side| three_bytes(side as u32 - 1));
    [a, b, c, d, e, f]
}

fn three_bytes(number: u32) -> [u8; 3] {
    let [low, middle, high, _] = number.to_le_bytes();
    [low, middle, high]
}

fn append_chunk(output: &mut Output, kind: &[u8; 4], bytes: &[u8]) -> Result<()> {
    output.append(kind)?;
    output.append(&(bytes.len() as u32).to_le_bytes())?;
    output.append(bytes)?;
    // Chunks start at even places.
    output.append(&[0][..bytes.len() % 2])
}
