//! The bytes of a tensor in C order, to be read by position.

use std::sync::Arc;

use super::array::Tensor;
use super::zip::Data;
use crate::base::bytes::Storage;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Budget;

/// Longer entries are inflated into a file.
const IN_MEMORY: u64 = 32 << 20;
/// Bytes that are read at once while a checksum is taken.
const PIECE: usize = 1 << 20;
/// Pieces of a tensor in a sample, evenly spaced from its first number to its last, and numbers of
/// each.
const GLANCES: u64 = 64;
const GLANCE: u64 = 4096;

impl Tensor {
    /// The tensor's bytes in C order. Stored bytes stay in their file; compressed ones are
    /// inflated, long ones into an unnamed file in the folder for temporary files. The file's
    /// checksums are verified, which reads all bytes.
    ///
    /// # Errors
    /// Errors of reading and inflating, `Checksum`, and more bytes than the budget has.
    pub fn storage(&self, budget: &mut Budget) -> Result<Storage> {
        if !self.is_dense() {
            return Ok(Storage::Memory(self.packed(budget)?.into()));
        }
        let (first, length) = (self.first * self.element().size() as u64, self.bytes());
        match &self.data {
            Data::Stored(Storage::File { file, range, crc32 }) => {
                if let Some(expected) = *crc32 {
                    verify(
                        &Storage::File {
                            file: Arc::clone(file),
                            range: range.clone(),
                            crc32: None,
                        },
                        expected,
                        &self.place(),
                    )?;
                }
                let start = range.start + first;
                let file = Arc::clone(file);
                Ok(Storage::File { file, range: start..start + length, crc32: None })
            }
            Data::Deflated { archive, entry, skip } if length > IN_MEMORY => {
                let file = Arc::new(archive.inflate_to_file(*entry, budget)?);
                let start = skip + first;
                Ok(Storage::File { file, range: start..start + length, crc32: None })
            }
            data => {
                let whole = data.storage(budget)?;
                let Storage::Memory(bytes) = &whole else { return Ok(whole) };
                let at = |offset: u64| usize::try_from(offset).unwrap_or(usize::MAX);
                let part = bytes.get(at(first)..at(first.saturating_add(length)));
                Ok(match part {
                    Some(part) if part.len() < bytes.len() => Storage::Memory(part.into()),
                    _ => whole,
                })
            }
        }
    }
}

impl Tensor {
    /// A sample of the numbers, which usually reveals their range. Nothing is verified, and of
    /// compressed tensors only the start is read.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn glance(&self) -> Result<Vec<f32>> {
        let size = self.element().size() as u64;
        let most = self.span_length().min(GLANCES * GLANCE);
        let mut numbers = Vec::new();
        match &self.data {
            Data::Unread(_) => {}
            Data::Deflated { archive, entry, skip } => {
                let bytes = archive.head(*entry, skip + (self.first + most) * size)?;
                let start = usize::try_from(skip + self.first * size).unwrap_or(usize::MAX);
                self.decode_glance(bytes.get(start..).unwrap_or_default(), &mut numbers);
            }
            Data::Stored(storage) => {
                let count = most.min(GLANCE);
                let pieces = most.div_ceil(GLANCE).max(1);
                let last = self.span_length() - count;
                let mut bytes = vec![0; usize::try_from(count * size).unwrap_or(0)];
                for piece in 0..pieces {
                    let at = self.first + last * piece / pieces.saturating_sub(1).max(1);
                    storage.read_into(at * size, &mut bytes)?;
                    self.decode_glance(&bytes, &mut numbers);
                }
            }
        }
        Ok(numbers)
    }

    fn decode_glance(&self, bytes: &[u8], numbers: &mut Vec<f32>) {
        let start = numbers.len();
        numbers.resize(start + bytes.len() / self.element().size(), 0.0);
        self.element().decode(bytes, numbers.get_mut(start..).unwrap_or_default());
    }
}

/// Verifies all bytes against the file's checksum.
fn verify(storage: &Storage, expected: u32, place: &Place) -> Result<()> {
    let mut sum = crc32fast::Hasher::new();
    let mut piece = vec![0; PIECE];
    let mut at = 0;
    while at < storage.length() {
        let left = usize::try_from(storage.length() - at).unwrap_or(usize::MAX);
        let piece = piece.get_mut(..left.min(PIECE)).unwrap_or_default();
        storage.read_into(at, piece)?;
        sum.update(piece);
        at += piece.len() as u64;
    }
    let found = sum.finalize();
    if found == expected {
        return Ok(());
    }
    let what = "the tensor's storage".into();
    Err(Error::new(ErrorKind::Checksum { what, found, expected }, place.clone()))
}
