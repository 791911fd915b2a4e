//! A temporary file for bytes that do not fit into memory.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::base::error::{Error, Result};
use crate::base::lock::lock;

/// An unnamed file, which disappears with its last handle, however the program ends.
#[derive(Debug)]
pub struct Spill {
    file: Mutex<File>,
    /// Its folder, for messages.
    folder: PathBuf,
}

impl Spill {
    /// An empty file on the disk of `folder`.
    ///
    /// # Errors
    ///
    /// If no file can be made there.
    pub fn new(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(|error| Error::io(error, folder))?;
        Ok(Self { file: Mutex::new(file), folder: folder.to_owned() })
    }

    /// Appends `bytes` and returns their range.
    ///
    /// # Errors
    ///
    /// If they cannot be written: a full disk.
    pub fn append(&self, bytes: &[u8]) -> Result<Range<u64>> {
        let mut file = lock(&self.file);
        let start = file.seek(SeekFrom::End(0));
        let start = start.and_then(|start| file.write_all(bytes).map(|()| start));
        let start = start.map_err(|error| Error::io(error, &self.folder))?;
        Ok(start..start + bytes.len() as u64)
    }

    /// The bytes appended at `range`.
    ///
    /// # Errors
    ///
    /// If it cannot be read.
    pub fn read(&self, range: Range<u64>) -> Result<Vec<u8>> {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        let mut file = lock(&self.file);
        let read = file.seek(SeekFrom::Start(range.start));
        let read = read.and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|error| Error::io(error, &self.folder))?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_appended_is_read_in_any_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let spill = Spill::new(folder.path()).expect("a file");
        let ranges = [&b"abc"[..], b"", b"defgh"].map(|bytes| spill.append(bytes).expect("room"));
        let read = |i: usize| spill.read(ranges[i].clone()).expect("what was written");
        assert_eq!([read(2), read(0), read(1)], [&b"defgh"[..], b"abc", b""]);
        let names = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(names, 0, "a nameless file");
    }
}
