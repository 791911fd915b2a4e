//! Sinks for appended bytes.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result};

/// A sink for appended bytes: an output file, or any writer.
pub trait ByteSink {
    /// Appends `bytes`.
    ///
    /// # Errors
    ///
    /// Writing failed.
    fn append(&mut self, bytes: &[u8]) -> Result<()>;

    /// Bytes appended so far.
    fn length(&self) -> u64;

    /// A folder for temporary files.
    fn folder(&self) -> PathBuf;

    /// Appends zeros up to the next multiple of `alignment`.
    ///
    /// # Errors
    ///
    /// Writing failed.
    fn pad(&mut self, alignment: u64) -> Result<()> {
        let zeros = [0; 64];
        while !self.length().is_multiple_of(alignment) {
            let count = (alignment - self.length() % alignment).min(zeros.len() as u64);
            self.append(zeros.get(..count as usize).unwrap_or_default())?;
        }
        Ok(())
    }
}

/// Any writer, with a count of its bytes.
#[derive(Debug)]
pub struct WriterSink<W> {
    writer: W,
    length: u64,
}

impl<W: Write> WriterSink<W> {
    /// With a count of 0.
    pub fn new(writer: W) -> Self {
        Self { writer, length: 0 }
    }
}

impl<W: Write> ByteSink for WriterSink<W> {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.writer.write_all(bytes);
        written.map_err(|error| Error::io(error, Path::new("writer")))?;
        self.length += bytes.len() as u64;
        Ok(())
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn folder(&self) -> PathBuf {
        std::env::temp_dir()
    }
}
