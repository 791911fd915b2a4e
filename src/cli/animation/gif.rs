//! Animated GIFs.

use std::io::Write;
use std::path::{Path, PathBuf};

use gif::{Encoder, EncodingError, Frame, Repeat};

use super::format::FilmOptions;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Result};

/// The choice of a frame's 256 colours samples one of this many pixels: 1 is all, 30 the fewest.
const SPEED: i32 = 10;

/// A GIF that repeats forever.
pub struct GifFilm {
    encoder: Encoder<Appended>,
    path: PathBuf,
    options: FilmOptions,
    /// Frames so far.
    frames: usize,
}

/// An output as a writer.
struct Appended(Output);

impl Write for Appended {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.append(bytes).map_err(|error| std::io::Error::other(error.to_string()))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl GifFilm {
    pub fn start(output: Output, path: &Path, options: FilmOptions) -> Result<Self> {
        let [width, height] = options.size.map(|side| side as u16);
        let encoder = Encoder::new(Appended(output), width, height, &[]);
        let mut encoder = encoder.map_err(|error| failed(error, path))?;
        encoder.set_repeat(Repeat::Infinite).map_err(|error| failed(error, path))?;
        Ok(Self { encoder, path: path.to_owned(), options, frames: 0 })
    }

    pub fn add(&mut self, values: &[u8]) -> Result<()> {
        let [width, height] = self.options.size.map(|side| side as u16);
        let mut frame = match self.options.alpha {
            // Alpha is a single bit.
            true => {
                let mut values = values.to_vec();
                for pixel in values.as_chunks_mut::<4>().0 {
                    *pixel =
                        if pixel[3] < 128 { [0; 4] } else { [pixel[0], pixel[1], pixel[2], 255] };
                }
                let frame = Frame::from_rgba_speed(width, height, &mut values, SPEED);
                // Without this, moving objects leave traces.
                Frame { dispose: gif::DisposalMethod::Background, ..frame }
            }
            false => Frame::from_rgb_speed(width, height, values, SPEED),
        };
        // Hundredths of a second.
        frame.delay = self.options.delay(self.frames, 100.0) as u16;
        self.frames += 1;
        self.encoder.write_frame(&frame).map_err(|error| failed(error, &self.path))
    }

    pub fn finish(self) -> Result<()> {
        let output = self.encoder.into_inner().map_err(|error| failed(error, &self.path))?;
        output.0.finish()
    }
}

fn failed(error: EncodingError, path: &Path) -> Error {
    let error = match error {
        EncodingError::Io(error) => error,
        other => std::io::Error::other(other.to_string()),
    };
    Error::io(error, path)
}
