//! Loads bytes of a storage into memory, and verifies their checksum if that is cheap.

use crate::base::bytes::Storage;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget};

/// Storages of up to this many bytes are always read whole, so that their checksum can be verified.
const SMALL: u64 = 1 << 20;

/// Reads elements `start..end` of `storage`; verifies its checksum if that takes no more than
/// reading a small storage whole.
pub(super) fn load(
    storage: &Storage,
    start: u64,
    end: u64,
    size: u64,
    budget: &mut Budget,
    place: &Place,
) -> Result<Vec<u8>> {
    let length = limits::product(&[end - start, size], "tensor", place)?;
    let mut bytes: Vec<u8> = budget.zeroed(length, "tensor bytes", place)?;
    storage.read_into(start * size, &mut bytes)?;
    let Some(expected) = storage.crc32() else { return Ok(bytes) };
    let whole = storage.length();
    let found = if length as u64 == whole {
        crc32fast::hash(&bytes)
    } else if whole <= SMALL {
        let mut all = vec![0; limits::product(&[whole], "storage", place)?];
        storage.read_into(0, &mut all)?;
        crc32fast::hash(&all)
    } else {
        return Ok(bytes);
    };
    if found == expected {
        return Ok(bytes);
    }
    let what = "the tensor's storage".into();
    Err(Error::new(ErrorKind::Checksum { what, found, expected }, place.clone()))
}
