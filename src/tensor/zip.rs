//! The directory of a zip archive, and its entries: stored ones are read by position, deflated
//! ones are inflated under a budget.
//!
//! The archive starts with its file: nothing is searched beyond the end record's own places, so
//! opening reads the directory and one header an entry, whatever the archive's size.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

use ::zip::result::ZipError;
use ::zip::{CompressionMethod, HasZipMetadata as _, ZipArchive};

use super::array::Data;
use crate::bytes::{ByteReader, SourceFile, Storage};
use crate::error::{Error, ErrorKind, Place, Result};
use crate::limits::{self, Budget, Limits};

/// An archive whose directory was read and checked.
#[derive(Debug)]
pub struct Archive {
    file: Arc<SourceFile>,
    zip: ZipArchive<Positioned>,
    entries: Vec<Entry>,
    numbers: BTreeMap<String, usize>,
}

/// An entry of the directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its name, folders included.
    pub name: String,
    /// Offset of its bytes in the file.
    pub offset: u64,
    /// Whether its bytes are compressed.
    pub is_deflated: bool,
    /// Bytes in the file.
    pub packed: u64,
    /// Bytes once inflated.
    pub length: u64,
    /// Checksum of the inflated bytes.
    pub crc32: u32,
}
