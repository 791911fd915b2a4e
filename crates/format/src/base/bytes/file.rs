//! Files are read by position, never mapped: a file that shrinks under a map kills the process,
//! one that shrinks under a positioned read is an error with an offset.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::guard::Guard;
use super::read_at::ReadAt;
#[cfg(feature = "network")]
use super::remote::RemoteFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName};
use crate::base::lock::lock;

/// A file open for positioned reads from any thread, or an embedded part in its own format. Counts
/// the bytes that were read.
#[derive(Debug)]
pub struct SourceFile {
    bytes: Bytes,
    path: PathBuf,
    length: u64,
    bytes_read: AtomicU64,
}

#[derive(Debug)]
enum Bytes {
    /// From byte `start` of a file.
    File { file: Arc<OpenFile>, start: u64 },
    /// From byte `start` of memory, or of an embedding program's source.
    Held { bytes: Arc<dyn ReadAt>, start: u64 },
    /// From byte `start` of a file at an address.
    #[cfg(feature = "network")]
    Remote { file: Arc<RemoteFile>, start: u64 },
}

#[derive(Debug)]
struct OpenFile {
    file: File,
    /// An output of the same name would lose the input.
    guard: Mutex<Option<Guard>>,
}

impl SourceFile {
    /// Lets outputs replace the file while it is open. Outputs are renamed into place, so the open
    /// file stays readable.
    pub fn unguard(&self) {
        if let Bytes::File { file, .. } = &self.bytes {
            drop(lock(&file.guard).take());
        }
    }

    /// Opens a regular file, or one at an address if that is allowed.
    pub fn open(path: &Path) -> Result<Self> {
        #[cfg(feature = "network")]
        if let Some(address) = super::address::address(path) {
            let file = Arc::new(RemoteFile::open(address)?);
            let length = file.length();
            let bytes = Bytes::Remote { file, start: 0 };
            return Ok(Self::new(bytes, &super::address::shown(address), length));
        }
        let io = |error| Error::io(error, path);
        // Tested before opening, because opening a pipe waits for a writer.
        let found = std::fs::metadata(path).map_err(io)?;
        if found.is_dir() {
            return Err(io(std::io::ErrorKind::IsADirectory.into()));
        }
        if !found.is_file() {
            return Err(io(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                "not a regular file: it cannot be read by position",
            )));
        }
        let file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        let length = metadata.len();
        let file = Arc::new(OpenFile { file, guard: Mutex::new(Guard::of(path)) });
        Ok(Self::new(Bytes::File { file, start: 0 }, path, length))
    }

    /// An unnamed file of bytes that were decoded from the file `path`.
    pub fn nameless(file: File, path: &Path, length: u64) -> Self {
        let file = Arc::new(OpenFile { file, guard: Mutex::new(None) });
        Self::new(Bytes::File { file, start: 0 }, path, length)
    }

    /// Bytes that were decoded from the file `path`.
    pub fn decoded(bytes: Vec<u8>, path: &Path) -> Self {
        let length = bytes.len() as u64;
        Self::new(Bytes::Held { bytes: Arc::new(bytes), start: 0 }, path, length)
    }

    /// Bytes that are read by position, under the name `path` in messages.
    ///
    /// # Errors
    ///
    /// `Io` if their length is unknown.
    pub fn held(bytes: Arc<dyn ReadAt>, path: &Path) -> Result<Self> {
        let length = bytes.length().map_err(|error| Error::io(error, path))?;
        Ok(Self::new(Bytes::Held { bytes, start: 0 }, path, length))
    }

    /// A part of the file as a separate file, with offsets from the part's start.
    pub fn part(&self, range: Range<u64>) -> Result<Self> {
        let wanted = range.end.saturating_sub(range.start);
        if range.end > self.length {
            let left = self.length.saturating_sub(range.start);
            let kind = ErrorKind::Truncated { wanted, left };
            return Err(Error::new(kind, Place::Offset(range.start)).in_file(&self.path));
        }
        let bytes = match &self.bytes {
            Bytes::File { file, start } => {
                Bytes::File { file: Arc::clone(file), start: start + range.start }
            }
            Bytes::Held { bytes, start } => {
                Bytes::Held { bytes: Arc::clone(bytes), start: start + range.start }
            }
            #[cfg(feature = "network")]
            Bytes::Remote { file, start } => {
                Bytes::Remote { file: Arc::clone(file), start: start + range.start }
            }
        };
        Ok(Self::new(bytes, &self.path, wanted))
    }

    fn new(bytes: Bytes, path: &Path, length: u64) -> Self {
        Self { bytes, path: path.to_owned(), length, bytes_read: AtomicU64::new(0) }
    }

    /// Its name when opened.
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
        let (file, start) = match &self.bytes {
            Bytes::File { file, start } => (file, start),
            Bytes::Held { bytes, start } => {
                let read = bytes.read_at(start + offset, out);
                read.map_err(|error| Error::io(error, &self.path))?;
                self.bytes_read.fetch_add(wanted, Ordering::Relaxed);
                return Ok(());
            }
            #[cfg(feature = "network")]
            Bytes::Remote { file, start } => {
                file.read_into(start + offset, out)?;
                self.bytes_read.fetch_add(wanted, Ordering::Relaxed);
                return Ok(());
            }
        };
        file.file.read_at(start + offset, out).map_err(|error| match error.kind() {
            // The file shrank since it was opened.
            std::io::ErrorKind::UnexpectedEof => {
                let now = file.file.metadata().map_or(0, |metadata| metadata.len());
                truncated(now.saturating_sub(start + offset))
            }
            _ => Error::new(ErrorKind::Io(error), Place::Offset(offset)).in_file(&self.path),
        })?;
        self.bytes_read.fetch_add(wanted, Ordering::Relaxed);
        Ok(())
    }

    /// Calls `take` with all bytes in order, piece by piece.
    pub fn for_each_piece(&self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        const PIECE: u64 = 1 << 20;
        let mut piece = vec![0; PIECE.min(self.length) as usize];
        let mut at = 0;
        while at < self.length {
            let count = PIECE.min(self.length - at);
            let piece = piece.get_mut(..count as usize).unwrap_or_default();
            self.read_into(at, piece)?;
            take(piece)?;
            at += count;
        }
        Ok(())
    }

    /// Reads `count` bytes of a header or table, which may be at most `allowed`.
    pub fn read(&self, offset: u64, count: u64, allowed: u64) -> Result<Vec<u8>> {
        self.read_bounded(offset, count, (LimitName::HeaderBytes, "header bytes"), allowed)
    }

    /// Reads `count` bytes of `what`, as an error names it, which may be at most `allowed` by a
    /// limit.
    pub fn read_bounded(
        &self,
        offset: u64,
        count: u64,
        (limit, what): (LimitName, &'static str),
        allowed: u64,
    ) -> Result<Vec<u8>> {
        let place = Place::Offset(offset);
        let in_file = |error: Error| error.in_file(&self.path);
        if count > self.length.saturating_sub(offset) {
            let left = self.length.saturating_sub(offset);
            return Err(in_file(Error::new(ErrorKind::Truncated { wanted: count, left }, place)));
        }
        limits::check(limit, what, count, allowed, &place).map_err(in_file)?;
        let count = limits::product(&[count], "length", &place).map_err(in_file)?;
        let mut out = vec![0; count];
        self.read_into(offset, &mut out)?;
        Ok(out)
    }
}
