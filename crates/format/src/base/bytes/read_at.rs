//! Reads at positions.

use std::fmt::Debug;
use std::fs::File;
use std::io;
use std::sync::Arc;

/// Bytes that are read by position, from any thread: a file, memory, or a source of an embedding
/// program. Inputs are read piece by piece, never copied as a whole.
pub trait ReadAt: Debug + Send + Sync {
    /// Total bytes, which must not decrease.
    ///
    /// # Errors
    ///
    /// Errors of the source.
    fn length(&self) -> io::Result<u64>;

    /// Fills `out` from `offset`. Both are within the length.
    ///
    /// # Errors
    ///
    /// Errors of the source.
    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()>;
}

/// Bytes in memory.
macro_rules! in_memory {
    ($($of:ty),*) => {$(
        impl ReadAt for $of {
            fn length(&self) -> io::Result<u64> {
                Ok(self.len() as u64)
            }

            fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
                let from = usize::try_from(offset).map_err(io::Error::other)?;
                let bytes = self.get(from..).and_then(|rest| rest.get(..out.len()));
                out.copy_from_slice(bytes.ok_or(io::ErrorKind::UnexpectedEof)?);
                Ok(())
            }
        }
    )*};
}
in_memory!(Vec<u8>, Arc<[u8]>, &'static [u8]);

impl ReadAt for File {
    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_at(&self, mut offset: u64, mut out: &mut [u8]) -> io::Result<()> {
        while !out.is_empty() {
            match some_at(self, out, offset) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => {
                    out = out.get_mut(count..).unwrap_or_default();
                    offset += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(unix)]
fn some_at(file: &File, out: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, out, offset)
}

#[cfg(windows)]
fn some_at(file: &File, out: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, out, offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_memory_read_the_same() {
        let bytes: Vec<u8> = (0..1000u32).map(|i| (i * 7) as u8).collect();
        let mut file = tempfile::tempfile().expect("a temporary file");
        io::Write::write_all(&mut file, &bytes).expect("writable");
        let shared: Arc<[u8]> = bytes.clone().into();
        let sources: [&dyn ReadAt; 3] = [&file, &bytes, &shared];
        for source in sources {
            assert_eq!(source.length().expect("a length"), 1000);
            let mut out = [0; 10];
            source.read_at(990, &mut out).expect("within");
            assert_eq!(out, bytes[990..]);
            let error = source.read_at(991, &mut out).expect_err("beyond");
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
            assert!(source.read_at(u64::MAX, &mut out).is_err());
        }
    }
}
