//! Files are read by position, never mapped: a file that shrinks under a map kills the process,
//! one that shrinks under a positioned read is an error with an offset.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, ErrorKind, Place, Result};
use crate::limits;

/// A file open for positioned reads from any thread. Counts the bytes that were read.
#[derive(Debug)]
pub struct SourceFile {
    file: File,
    path: PathBuf,
    length: u64,
    bytes_read: AtomicU64,
}

impl SourceFile {
    /// Opens a regular file.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |error| Error::io(error, path);
        // Looked at before it is opened: opening a pipe waits for somebody to write to it.
        let found = std::fs::metadata(path).map_err(io)?;
        if found.is_dir() {
            return Err(io(std::io::ErrorKind::IsADirectory.into()));
        }
        if !found.is_file() {
            return Err(io(std::io::Error::other(
                "not a regular file: it cannot be read by position",
            )));
        }
        let file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        let length = metadata.len();
        Ok(Self { file, path: path.to_owned(), length, bytes_read: AtomicU64::new(0) })
    }

    /// Its name, as it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its length in bytes when it was opened.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes read so far, by every thread.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// Fills `out` from `offset`.
    pub fn read_into(&self, offset: u64, out: &mut [u8]) -> Result<()> {
        let wanted = out.len() as u64;
        let left = self.length.saturating_sub(offset);
        let truncated = |left| {
            let kind = ErrorKind::Truncated { wanted, left };
            Error::new(kind, Place::Offset(offset)).in_file(&self.path)
        };
        if wanted > left {
            return Err(truncated(left));
        }
        let mut done = 0;
        while let Some(rest) = out.get_mut(done..).filter(|rest| !rest.is_empty()) {
            match read_at(&self.file, rest, offset + done as u64) {
                // The file shrank since it was opened.
                Ok(0) => return Err(truncated(done as u64)),
                Ok(count) => done += count,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => {
                    let kind = ErrorKind::Io(error);
                    return Err(Error::new(kind, Place::Offset(offset)).in_file(&self.path));
                }
            }
        }
        self.bytes_read.fetch_add(wanted, Ordering::Relaxed);
        Ok(())
    }

    /// Reads `count` bytes of a header or table, which may be at most `allowed`.
    pub fn read(&self, offset: u64, count: u64, allowed: u64) -> Result<Vec<u8>> {
        let place = Place::Offset(offset);
        let in_file = |error: Error| error.in_file(&self.path);
        if count > self.length.saturating_sub(offset) {
            let left = self.length.saturating_sub(offset);
            return Err(in_file(Error::new(ErrorKind::Truncated { wanted: count, left }, place)));
        }
        limits::check("header bytes", count, allowed, &place).map_err(in_file)?;
        let count = limits::product(&[count], "length", &place).map_err(in_file)?;
        let mut out = vec![0; count];
        self.read_into(offset, &mut out)?;
        Ok(out)
    }
}

#[cfg(unix)]
fn read_at(file: &File, out: &mut [u8], offset: u64) -> std::io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, out, offset)
}

#[cfg(windows)]
fn read_at(file: &File, out: &mut [u8], offset: u64) -> std::io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, out, offset)
}
