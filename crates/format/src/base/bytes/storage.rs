//! Bytes of a tensor, in a file or in memory.

use std::ops::Range;
use std::sync::Arc;

use super::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};

/// A run of bytes: a range of a file, or memory (for entries that had to be inflated).
#[derive(Debug, Clone)]
pub enum Storage {
    /// Bytes `range` of `file`.
    File {
        /// The file, read by position.
        file: Arc<SourceFile>,
        /// Offsets in the file.
        range: Range<u64>,
        /// CRC-32 of the whole range, where the format states one.
        crc32: Option<u32>,
    },
    /// Bytes already in memory, with a verified checksum if the format has one.
    Memory(Arc<[u8]>),
}

impl Storage {
    /// Bytes in all.
    pub fn length(&self) -> u64 {
        match self {
            Self::File { range, .. } => range.end.saturating_sub(range.start),
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    /// Stated checksum of all bytes, which the reader must still verify.
    pub fn crc32(&self) -> Option<u32> {
        match self {
            Self::File { crc32, .. } => *crc32,
            Self::Memory(_) => None,
        }
    }

    /// Fills `out` from `offset`, counted from the storage's own start.
    pub fn read_into(&self, offset: u64, out: &mut [u8]) -> Result<()> {
        let wanted = out.len() as u64;
        let left = self.length().saturating_sub(offset);
        match self {
            Self::File { file, range, .. } if wanted <= left => {
                file.read_into(range.start + offset, out)
            }
            Self::Memory(bytes) if wanted <= left => {
                let start = offset as usize;
                out.copy_from_slice(bytes.get(start..start + out.len()).unwrap_or_default());
                Ok(())
            }
            _ => {
                let kind = ErrorKind::Truncated { wanted, left };
                Err(Error::new(kind, self.place(offset)))
            }
        }
    }

    fn place(&self, offset: u64) -> Place {
        match self {
            Self::File { range, .. } => Place::Offset(range.start.saturating_add(offset)),
            Self::Memory(_) => Place::File,
        }
    }
}
