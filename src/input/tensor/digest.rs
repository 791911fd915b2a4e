//! A digest of an input that needs no full read.
//!
//! SHA-256 over the parts that a tensor file is opened with. Of a zip archive these are the names,
//! sizes and checksums of its directory, which stand for all bytes, and the pickle or the array
//! headers; of a safetensors file, which has no checksums, the header alone.

use sha2::{Digest as _, Sha256};

use super::zip::Entry;

/// A digest being made.
pub(super) struct Digest(Sha256);

impl Digest {
    /// A digest of a file of this kind.
    pub(super) fn new(kind: &str) -> Self {
        let mut digest = Self(Sha256::new());
        digest.bytes(kind.as_bytes());
        digest
    }

    /// Adds bytes; their count goes first, so that parts cannot run into each other.
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }

    /// Adds a zip directory.
    pub(super) fn directory(&mut self, entries: &[Entry]) {
        for entry in entries {
            self.bytes(entry.name.as_bytes());
            self.0.update(entry.packed.to_le_bytes());
            self.0.update(entry.length.to_le_bytes());
            self.0.update(entry.crc32.to_le_bytes());
        }
    }

    /// The digest of all that was added.
    pub(super) fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}
