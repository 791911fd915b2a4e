//! The directory of a zip archive, and its entries: stored ones are read by position, deflated
//! ones are inflated under a budget.
//!
//! The archive must start with its file. Only the places of the end record are searched, so opening
//! reads the directory and one header per entry, whatever the archive's size.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::sync::Arc;

use ::zip::result::ZipError;
use ::zip::{CompressionMethod, ZipArchive};

use super::positioned::Positioned;
use super::unread::Unread;
use crate::base::bytes::{ByteReader, SourceFile, Storage};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};

/// Bytes that are inflated at once.
const INFLATED_PIECE: usize = 1 << 20;

/// An archive whose directory was read and checked.
#[derive(Debug)]
pub struct Archive {
    file: Arc<SourceFile>,
    zip: ZipArchive<Positioned>,
    entries: Vec<Entry>,
    numbers: BTreeMap<String, usize>,
    states_sums: bool,
}

/// An entry of the directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its name, folders included.
    pub name: String,
    /// Offset of its bytes in the file.
    pub offset: u64,
    /// True if its bytes are compressed.
    pub is_deflated: bool,
    /// Bytes in the file.
    pub packed: u64,
    /// Bytes once inflated.
    pub length: u64,
    /// Checksum of the inflated bytes.
    pub crc32: u32,
}

/// The place of a tensor's bytes.
#[derive(Debug, Clone)]
pub enum Data {
    /// Uncompressed, in a file or in memory.
    Stored(Storage),
    /// In a compressed entry of an archive, inflated when needed.
    Deflated {
        /// The archive.
        archive: Arc<Archive>,
        /// Number of the entry.
        entry: usize,
        /// Inflated bytes before the storage starts.
        skip: u64,
    },
    /// Of an unsupported kind, with the reason for errors.
    Unread(Arc<Unread>),
}

impl Data {
    /// Bytes in all, once inflated.
    pub fn length(&self) -> u64 {
        match self {
            Self::Stored(storage) => storage.length(),
            Self::Deflated { archive, entry, skip } => archive.length(*entry).saturating_sub(*skip),
            Self::Unread(_) => 0,
        }
    }

    /// The bytes, readable by position; inflates them if necessary.
    pub fn storage(&self, budget: &mut Budget) -> Result<Storage> {
        match self {
            Self::Stored(storage) => Ok(storage.clone()),
            Self::Deflated { archive, entry, skip } => {
                let mut bytes = archive.inflate(*entry, budget)?;
                let skip = usize::try_from(*skip).unwrap_or(usize::MAX).min(bytes.len());
                bytes.drain(..skip);
                Ok(Storage::Memory(bytes.into()))
            }
            Self::Unread(unread) => Err(unread.error()),
        }
    }
}

impl Archive {
    /// Reads the directory of `file`, which must have at most `limits.entries` entries, no two of
    /// one name, each inside the file.
    pub fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        check_entry_count(file, limits)?;
        let config = ::zip::read::Config { archive_offset: ::zip::read::ArchiveOffset::Known(0) };
        let positioned = Positioned { file: Arc::clone(file), at: 0 };
        let mut zip = ZipArchive::with_config(config, positioned)
            .map_err(|error| without_directory(error, file.length()))?;
        if zip.has_duplicate_names() {
            let found = "two entries of one name in the zip directory";
            return Err(Error::malformed(
                Place::Offset(zip.central_directory_start()),
                found,
                "a name for each entry",
            ));
        }
        limits::check(
            LimitName::Entries,
            "zip entries",
            zip.len() as u64,
            limits.entries,
            &Place::File,
        )?;
        let mut entries = Vec::with_capacity(zip.len());
        let mut numbers = BTreeMap::new();
        for number in 0..zip.len() {
            let entry = read_entry(&mut zip, number, file.length())?;
            numbers.insert(entry.name.clone(), number);
            entries.push(entry);
        }
        // PyTorch can leave checksums out: it writes 0 for those of all entries.
        let mut full = entries.iter().filter(|entry| entry.length > 0);
        let states_sums =
            entries.iter().all(|entry| entry.length == 0) || full.any(|entry| entry.crc32 != 0);
        Ok(Self { file: Arc::clone(file), zip, entries, numbers, states_sums })
    }

    /// True if the directory states the checksums of its entries.
    pub(super) fn states_sums(&self) -> bool {
        self.states_sums
    }

    /// The entries, in the directory's order.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The number of the entry of this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.numbers.get(name).copied()
    }

    /// Bytes of an entry once inflated.
    pub(super) fn length(&self, number: usize) -> u64 {
        self.entries.get(number).map_or(0, |entry| entry.length)
    }

    /// The place of an entry's bytes; none of them is read.
    pub fn data(self: &Arc<Self>, number: usize) -> Result<Data> {
        let entry = self.entry(number)?;
        if entry.is_deflated {
            return Ok(Data::Deflated { archive: Arc::clone(self), entry: number, skip: 0 });
        }
        Ok(Data::Stored(Storage::File {
            file: Arc::clone(&self.file),
            range: entry.offset..entry.offset + entry.length,
            crc32: self.states_sums.then_some(entry.crc32),
        }))
    }

    /// All bytes of an entry of at most `allowed` bytes, their checksum verified.
    pub fn read(&self, number: usize, allowed: u64) -> Result<Vec<u8>> {
        let entry = self.entry(number)?;
        let place = Place::Entry(entry.name.clone());
        limits::check(LimitName::HeaderBytes, "bytes of a header", entry.length, allowed, &place)?;
        if entry.is_deflated {
            let limits = Limits::default().with_memory(allowed);
            return self.inflate(number, &mut Budget::new(&limits));
        }
        let bytes = self.file.read(entry.offset, entry.length, allowed)?;
        let found = crc32fast::hash(&bytes);
        if self.states_sums && found != entry.crc32 {
            let what = "the entry".into();
            let kind = ErrorKind::Checksum { what, found, expected: entry.crc32 };
            return Err(Error::new(kind, place));
        }
        Ok(bytes)
    }

    /// The first `count` bytes of an entry, or all if it is shorter. Not verified.
    pub fn head(&self, number: usize, count: u64) -> Result<Vec<u8>> {
        let entry = self.entry(number)?;
        let count = count.min(entry.length);
        if !entry.is_deflated {
            return self.file.read(entry.offset, count, count);
        }
        self.inflate_prefix(number, count)
    }

    /// All bytes of an entry, inflated; the checksum is verified.
    pub(super) fn inflate(&self, number: usize, budget: &mut Budget) -> Result<Vec<u8>> {
        let entry = self.entry(number)?;
        let place = Place::Entry(entry.name.clone());
        budget.spend(entry.length, "inflated bytes", &place)?;
        let bytes = self.inflate_prefix(number, entry.length)?;
        if bytes.len() as u64 == entry.length {
            return Ok(bytes);
        }
        let kind = ErrorKind::Truncated { wanted: entry.length, left: bytes.len() as u64 };
        Err(Error::new(kind, place))
    }

    /// Inflates up to `count` bytes. Memory grows with the actual bytes, not with the stated ones;
    /// more than stated, or a wrong checksum at the end, is an error.
    fn inflate_prefix(&self, number: usize, count: u64) -> Result<Vec<u8>> {
        let entry = self.entry(number)?;
        let place = || Place::Entry(entry.name.clone());
        // Clones share the directory; only the reading position is separate.
        let mut zip = self.zip.clone();
        let mut reader = zip.by_index(number).map_err(|error| refused(error, place()))?;
        let mut bytes = Vec::new();
        // Requesting one byte more makes the decoder reach the end and verify the checksum.
        let wanted = if count == entry.length { count.saturating_add(1) } else { count };
        let read = Read::by_ref(&mut reader).take(wanted).read_to_end(&mut bytes);
        read.map_err(|error| refused(ZipError::Io(error), place()))?;
        if bytes.len() as u64 > count {
            let found = format!("more than the {} bytes that the directory states", entry.length);
            return Err(Error::malformed(place(), found, "no more"));
        }
        Ok(bytes)
    }

    /// Inflates an entry into a nameless file in the folder for temporary files; the checksum is
    /// verified. The budget bounds the bytes.
    pub(super) fn inflate_to_file(&self, number: usize, budget: &mut Budget) -> Result<SourceFile> {
        let entry = self.entry(number)?;
        let place = || Place::Entry(entry.name.clone());
        budget.spend(entry.length, "inflated bytes", &place())?;
        let mut zip = self.zip.clone();
        let mut reader = zip.by_index(number).map_err(|error| refused(error, place()))?;
        let folder = std::env::temp_dir();
        let mut file = tempfile::tempfile().map_err(|error| Error::io(error, &folder))?;
        let mut left = entry.length;
        let mut piece = vec![0; INFLATED_PIECE];
        loop {
            let read = reader.read(&mut piece);
            let count = read.map_err(|error| refused(ZipError::Io(error), place()))? as u64;
            if count == 0 {
                break;
            }
            left = left.checked_sub(count).ok_or_else(|| {
                let found =
                    format!("more than the {} bytes that the directory states", entry.length);
                Error::malformed(place(), found, "no more")
            })?;
            let bytes = piece.get(..usize::try_from(count).unwrap_or(0)).unwrap_or_default();
            file.write_all(bytes).map_err(|error| Error::io(error, &folder))?;
        }
        if left > 0 {
            let kind = ErrorKind::Truncated { wanted: entry.length, left: entry.length - left };
            return Err(Error::new(kind, place()));
        }
        Ok(SourceFile::nameless(file, self.file.path(), entry.length))
    }

    fn entry(&self, number: usize) -> Result<&Entry> {
        self.entries.get(number).ok_or_else(|| {
            Error::malformed(Place::File, format!("zip entry number {number}"), "one that exists")
        })
    }
}

/// Reads one entry's headers and checks them against the file's length.
fn read_entry(zip: &mut ZipArchive<Positioned>, number: usize, length: u64) -> Result<Entry> {
    let header = zip.by_index_data(number).map_or(0, |entry| entry.header_start());
    let raw = zip.by_index_raw(number).map_err(|error| refused(error, Place::Offset(header)))?;
    let Ok(name) = String::from_utf8(raw.name_raw().to_vec()) else {
        let found = "an entry's name that is not UTF-8";
        return Err(Error::malformed(Place::Offset(header), found, "UTF-8"));
    };
    let place = Place::Entry(name.clone());
    if raw.encrypted() {
        return Err(Error::unsupported(place, "an encrypted entry", "a plain one"));
    }
    let is_deflated = match raw.compression() {
        CompressionMethod::STORE => false,
        CompressionMethod::DEFLATE => true,
        method => {
            let found = format!("compression method {method}");
            return Err(Error::unsupported(place, found, "stored or deflated"));
        }
    };
    let (packed, inflated) = (raw.compressed_size(), raw.size());
    let offset = raw.data_start().unwrap_or(u64::MAX);
    let left = length.saturating_sub(offset);
    if packed > left {
        return Err(Error::new(ErrorKind::Truncated { wanted: packed, left }, place));
    }
    if !is_deflated && packed != inflated {
        let found = format!("{packed} bytes stored for {inflated}");
        return Err(Error::malformed(place, found, "as many bytes stored as the entry is long"));
    }
    // Deflate gives at most 1032 bytes for one.
    if is_deflated && inflated / 1032 > packed {
        let found = format!("{packed} bytes that would inflate to {inflated}");
        return Err(Error::malformed(place, found, "at most 1032 times as many"));
    }
    Ok(Entry { name, offset, is_deflated, packed, length: inflated, crc32: raw.crc32() })
}

/// Checks the counts of zip64 end records against the limit before the directory is read; an
/// ordinary end record cannot state more than 65,535.
fn check_entry_count(file: &SourceFile, limits: &Limits) -> Result<()> {
    const END: u64 = 22;
    const LOCATOR: usize = 20;
    let tail_length = file.length().min(END + (1 << 16) + LOCATOR as u64);
    let tail_start = file.length() - tail_length;
    let tail = file.read(tail_start, tail_length, tail_length)?;
    for (at, window) in tail.windows(LOCATOR).enumerate() {
        if !window.starts_with(b"PK\x06\x07") {
            continue;
        }
        let mut locator = ByteReader::new(window, tail_start + at as u64);
        locator.take(8)?;
        let end64 = locator.u64()?;
        // Signature, size, versions and disks (24), entries on this disk (8), entries.
        if file.length().saturating_sub(end64) < 40 {
            continue;
        }
        let record = file.read(end64, 40, 40)?;
        if !record.starts_with(b"PK\x06\x06") {
            continue;
        }
        let mut record = ByteReader::new(&record, end64);
        record.take(32)?;
        limits::check(
            LimitName::Entries,
            "zip entries",
            record.u64()?,
            limits.entries,
            &Place::Offset(end64),
        )?;
    }
    Ok(())
}

/// The error for an archive of `length` bytes whose directory could not be read.
fn without_directory(error: ZipError, length: u64) -> Error {
    let place = Place::Offset(length);
    match error {
        ZipError::InvalidArchive(_) => {
            let found = "a zip archive without a directory at its end";
            Error::malformed(place, found, "all of the file").advise("copy it again")
        }
        error => refused(error, place),
    }
}

/// The crate's error for an error of the zip reader at `place`.
fn refused(error: ZipError, place: Place) -> Error {
    match error {
        ZipError::Io(error) => match error.kind() {
            io::ErrorKind::UnexpectedEof
            | io::ErrorKind::InvalidData
            | io::ErrorKind::InvalidInput
            | io::ErrorKind::Other => {
                let found = format!("bytes that do not unpack ({error})");
                Error::malformed(place, found, "an undamaged zip entry")
            }
            _ => Error::new(ErrorKind::Io(error), place),
        },
        ZipError::UnsupportedArchive(what) => {
            Error::unsupported(place, what, "a plain zip archive in one file")
        }
        ZipError::CompressionMethodNotSupported(method) => {
            Error::unsupported(place, format!("compression method {method}"), "stored or deflated")
        }
        other => Error::malformed(place, format!("{other}"), "a whole zip archive"),
    }
}
