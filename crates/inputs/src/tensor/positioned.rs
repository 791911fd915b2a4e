//! A file as a seekable reader.

use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

use crate::base::bytes::SourceFile;
use crate::base::error::ErrorKind;

/// A separate reading position in a shared file.
#[derive(Debug, Clone)]
pub(super) struct Positioned {
    pub(super) file: Arc<SourceFile>,
    pub(super) at: u64,
}

impl Read for Positioned {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let left =
            usize::try_from(self.file.length().saturating_sub(self.at)).unwrap_or(usize::MAX);
        let count = out.len().min(left);
        let Some(out) = out.get_mut(..count) else { return Ok(0) };
        self.file.read_into(self.at, out).map_err(|error| match error.kind() {
            ErrorKind::Io(inner) => io::Error::new(inner.kind(), error.to_string()),
            _ => io::Error::new(io::ErrorKind::UnexpectedEof, error.to_string()),
        })?;
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Positioned {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.file.length().checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}
