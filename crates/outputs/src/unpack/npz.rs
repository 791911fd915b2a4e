//! A NumPy archive to which tensors are appended in order.
//!
//! Members are stored, not compressed, so that readers can read parts of them. The texts of
//! safetensors' `__metadata__` are members too: `__metadata__.NAME`, a NumPy text without axes.

use std::collections::VecDeque;
use std::io::Write;
use std::path::{Path, PathBuf};

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipWriter};

use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Result};
use mipvog::unpacked::Row;

/// Length of a member from which its directory entry needs 64-bit sizes.
const LARGE: u64 = u32::MAX as u64;

/// An archive that is being written.
pub struct NpzSink<'a> {
    zip: ZipWriter<StreamWriter<Appender<'a>>>,
    /// Members to come, behind the current one.
    rows: VecDeque<Row>,
    /// Bytes that the current member still needs.
    left: u64,
    length: u64,
    folder: PathBuf,
}

struct Appender<'a> {
    output: &'a mut Output,
    /// True once writing failed. An archive that is dropped then still writes its end, and would
    /// print that it cannot.
    has_failed: bool,
}

impl Write for Appender<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if !self.has_failed {
            let written = self.output.append(bytes);
            self.has_failed = written.is_err();
            written.map_err(|error| std::io::Error::new(error.io_kind(), error.to_string()))?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl<'a> NpzSink<'a> {
    /// An archive of `texts`, and of `rows` whose bytes are appended in their order.
    ///
    /// # Errors
    ///
    /// Writing failed.
    pub fn new<'t>(
        output: &'a mut Output,
        texts: impl IntoIterator<Item = (&'t str, &'t str)>,
        rows: Vec<Row>,
    ) -> Result<Self> {
        let folder = output.folder();
        let zip = ZipWriter::new_stream(Appender { output, has_failed: false });
        let mut sink = Self { zip, rows: rows.into(), left: 0, length: 0, folder };
        for (name, text) in texts {
            let characters: Vec<u8> =
                text.chars().flat_map(|character| u32::from(character).to_le_bytes()).collect();
            let descr = format!("<U{}", characters.len() / 4);
            sink.start(&format!("__metadata__.{name}"), &descr, &[], characters.len() as u64)?;
            sink.write(&characters)?;
        }
        sink.left = 0;
        Ok(sink)
    }

    /// Ends the archive.
    ///
    /// # Errors
    ///
    /// Writing failed.
    pub fn finish(self) -> Result<()> {
        self.zip.finish().map(|_| ()).map_err(failed)
    }

    fn start(&mut self, name: &str, descr: &str, shape: &[usize], bytes: u64) -> Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(bytes >= LARGE);
        self.zip.start_file(format!("{name}.npy"), options).map_err(failed)?;
        self.write(&header(descr, shape))?;
        self.left = bytes;
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.zip.write_all(bytes).map_err(|error| failed(error.into()))
    }
}

impl ByteSink for NpzSink<'_> {
    fn append(&mut self, mut bytes: &[u8]) -> Result<()> {
        self.length += bytes.len() as u64;
        while !bytes.is_empty() {
            if self.left == 0 {
                let Some(row) = self.rows.pop_front() else { break };
                self.start(&row.name, row.numpy_type(), &row.shape, row.bytes)?;
            }
            let count = usize::try_from(self.left).unwrap_or(usize::MAX).min(bytes.len());
            let (own, rest) = bytes.split_at(count);
            self.write(own)?;
            self.left -= count as u64;
            bytes = rest;
        }
        Ok(())
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn folder(&self) -> PathBuf {
        self.folder.clone()
    }
}

/// The header of an array in C order: version 1 of the format, padded to a multiple of 64 bytes.
fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    const BEFORE: usize = 10;
    let axes: String = shape.iter().map(|size| format!("{size}, ")).collect();
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({axes}), }}");
    let padding = (BEFORE + text.len() + 1).next_multiple_of(64) - (BEFORE + text.len() + 1);
    text.extend(std::iter::repeat_n(' ', padding));
    text.push('\n');
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((text.len() as u16).to_le_bytes());
    header.extend(text.into_bytes());
    header
}

fn failed(error: zip::result::ZipError) -> Error {
    Error::io(error.into(), Path::new("archive"))
}
