//! A digest of an input without a full read.
//!
//! SHA-256 over the parts that a tensor file is opened with. For a zip archive, these are the
//! names, sizes and checksums of its directory, which cover all bytes, and the pickle or the array
//! headers; for a safetensors file, which has no checksums, only the header.

pub(super) use crate::base::bytes::Digest;

use super::zip::Entry;

/// Adds a zip directory.
pub(super) fn add_directory(digest: &mut Digest, entries: &[Entry]) {
    for entry in entries {
        digest.bytes(entry.name.as_bytes());
        digest.raw(&entry.packed.to_le_bytes());
        digest.raw(&entry.length.to_le_bytes());
        digest.raw(&entry.crc32.to_le_bytes());
    }
}
