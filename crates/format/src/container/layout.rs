//! Header and directory: the records in sections 2 and 3 of `formats/mipvog.md`.

use crate::base::bytes::ByteReader;
use crate::base::error::{Error, ErrorKind, NEWER, Place, Result};

pub use super::generated::{
    ANISOTROPY, ATLASES, BENT_RULE, CHUNKS, ChunkKind, DIRECTIONAL, FEATURES_SINCE,
    INHERITED_BLOCKS, KNOWN_FEATURE_BITS, KNOWN_FEATURES, LINEAR_VALUES, MASK, META, NESTED_BOXES,
    PROVENANCE, TABLE, THUMBNAIL, VERSION, VMLP,
};

/// First bytes of every container. As in PNG, a byte with its high bit set, the name, both line
/// endings and an end-of-file character make damage by text-mode transfers visible.
pub const SIGNATURE: [u8; 8] = [0x89, b'M', b'V', b'G', b'\r', b'\n', 0x1a, b'\n'];
/// Length of the header in bytes.
pub const HEADER_BYTES: u64 = 64;
/// Length of a directory entry in bytes.
pub const ENTRY_BYTES: u64 = 64;
/// Chunks start at multiples of this many bytes.
pub const ALIGNMENT: u64 = 64;
/// Offset of the header's checksum, which is treated as zero while it is computed.
const CHECKSUM_AT: usize = 48;
/// Level field of a chunk that belongs to no level.
const NO_LEVEL: u32 = u32::MAX;

/// The header of a container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Major and minor version of the format.
    pub version: [u16; 2],
    /// Features that a reader must know.
    pub features: u64,
    /// Length of the file in bytes.
    pub file_length: u64,
    /// Offset of the directory in bytes.
    pub directory_offset: u64,
    /// Number of directory entries.
    pub entries: u32,
    /// CRC-32 over header and directory.
    pub checksum: u32,
}

/// A chunk's entry in the directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Type of the chunk.
    pub kind: ChunkKind,
    /// Level that the chunk belongs to, if any.
    pub level: Option<u32>,
    /// Offset of its first byte in the file.
    pub offset: u64,
    /// Length in bytes, without padding.
    pub length: u64,
    /// Bytes from the start of the file that suffice to render this chunk's level; 0 without a
    /// level.
    pub prefix: u64,
    /// CRC-32 of the chunk's bytes.
    pub checksum: u32,
}

/// CRC-32 over the checksums of all chunks that hold values: levels, network and mask. Two
/// containers with the same metadata and the same sum hold the same values.
pub fn content_checksum(entries: &[Entry]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    for entry in entries.iter().filter(|entry| entry.is_critical() && entry.kind != META) {
        sum.update(&entry.kind);
        sum.update(&entry.level.unwrap_or(NO_LEVEL).to_le_bytes());
        sum.update(&entry.checksum.to_le_bytes());
    }
    sum.finalize()
}

impl Entry {
    /// True if a reader must understand the chunk.
    pub fn is_critical(&self) -> bool {
        self.kind.first().is_some_and(u8::is_ascii_uppercase)
    }

    /// The chunk's place, for errors.
    pub fn place(&self) -> Place {
        Place::Chunk { kind: self.kind, level: self.level }
    }

    /// Offset of the first byte after the padding; in an invalid directory, it can exceed the file.
    pub fn padded_end(&self) -> u64 {
        let end = self.offset.saturating_add(self.length);
        end.checked_next_multiple_of(ALIGNMENT).unwrap_or(u64::MAX)
    }

    fn to_bytes(self) -> [u8; 64] {
        let mut fields = Vec::with_capacity(64);
        fields.extend(self.kind);
        fields.extend(self.level.unwrap_or(NO_LEVEL).to_le_bytes());
        fields.extend(self.offset.to_le_bytes());
        fields.extend(self.length.to_le_bytes());
        fields.extend(self.prefix.to_le_bytes());
        fields.extend(self.checksum.to_le_bytes());
        padded(&fields)
    }

    fn read(reader: &mut ByteReader) -> Result<Self> {
        let place = reader.place();
        let kind = reader.array()?;
        let level = Some(reader.u32()?).filter(|&level| level != NO_LEVEL);
        let [offset, length, prefix] = [reader.u64()?, reader.u64()?, reader.u64()?];
        let entry = Self { kind, level, offset, length, prefix, checksum: reader.u32()? };
        if reader.take(28)?.iter().any(|&byte| byte != 0) {
            return Err(Error::malformed(place, "a reserved byte that is set", "zeros"));
        }
        if !kind.iter().all(u8::is_ascii_alphabetic) {
            let found = format!("chunk type {}", kind.escape_ascii());
            return Err(Error::malformed(place, found, "four letters"));
        }
        Ok(entry)
    }
}

impl Header {
    /// Header and directory as bytes, with their checksum. The version is the lowest that supports
    /// the `features`.
    pub fn with_directory(features: u64, file_length: u64, entries: &[Entry]) -> Result<Vec<u8>> {
        let count = u32::try_from(entries.len())
            .map_err(|_| Error::new(ErrorKind::Overflow { what: "directory" }, Place::File))?;
        let mut fields = Vec::with_capacity(64);
        fields.extend(SIGNATURE);
        let set = FEATURES_SINCE.iter().enumerate().filter(|(bit, _)| features >> bit & 1 == 1);
        let minor = set.map(|(_, &since)| since).max().unwrap_or(0);
        [VERSION[0], minor].iter().for_each(|part| fields.extend(part.to_le_bytes()));
        fields.extend([0; 4]);
        fields.extend(features.to_le_bytes());
        fields.extend(file_length.to_le_bytes());
        fields.extend(HEADER_BYTES.to_le_bytes());
        fields.extend(count.to_le_bytes());
        let mut bytes = padded(&fields).to_vec();
        entries.iter().for_each(|entry| bytes.extend(entry.to_bytes()));
        let checksum = crc32fast::hash(&bytes).to_le_bytes();
        for (byte, sum) in bytes.iter_mut().skip(CHECKSUM_AT).zip(checksum) {
            *byte = sum;
        }
        Ok(bytes)
    }

    /// Reads the fields. Checks only signature and version.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let mut reader = ByteReader::new(bytes, 0);
        let signature = reader.array()?;
        if signature != SIGNATURE {
            let found = format!("the bytes {}", signature.escape_ascii());
            return Err(Error::malformed(Place::Offset(0), found, "a container's signature"));
        }
        let version = [reader.u16()?, reader.u16()?];
        let reserved = reader.u32()?;
        let features = reader.u64()?;
        let [file_length, directory_offset] = [reader.u64()?, reader.u64()?];
        let entries = reader.u32()?;
        let reserved_too = reader.u32()?;
        let checksum = reader.u32()?;
        let rest = reader.take(12)?;
        let [major, minor] = version;
        if major != VERSION[0] {
            let found = format!("version {major}.{minor}");
            let error = Error::unsupported(Place::Offset(8), found, "major version 1");
            return Err(error.advise(NEWER));
        }
        let set = [(12, reserved != 0), (36, reserved_too != 0)].into_iter();
        let set = set.chain((44..).zip(rest.iter().map(|&byte| byte != 0)));
        if let Some((at, _)) = set.filter(|(_, is_set)| *is_set).min() {
            return Err(Error::malformed(
                Place::Offset(at),
                "a reserved byte of the header that is set",
                "zeros",
            ));
        }
        Ok(Self { version, features, file_length, directory_offset, entries, checksum })
    }
}

/// Reads the directory and verifies the checksum over it and the header.
pub fn read_directory(header: &Header, bytes: &[u8]) -> Result<Vec<Entry>> {
    let mut sum = crc32fast::Hasher::new();
    let (before, rest) = bytes.split_at_checked(CHECKSUM_AT).unwrap_or((bytes, &[]));
    sum.update(before);
    sum.update(&[0; 4]);
    sum.update(rest.get(4..).unwrap_or_default());
    let found = sum.finalize();
    if found != header.checksum {
        let what = "header and directory".to_owned();
        let kind = ErrorKind::Checksum { what, found, expected: header.checksum };
        return Err(Error::new(kind, Place::Offset(CHECKSUM_AT as u64)));
    }
    let directory = bytes.get(64..).unwrap_or_default();
    let mut reader = ByteReader::new(directory, HEADER_BYTES);
    (0..header.entries).map(|_| Entry::read(&mut reader)).collect()
}

fn padded(fields: &[u8]) -> [u8; 64] {
    let mut record = [0; 64];
    record.iter_mut().zip(fields).for_each(|(byte, &field)| *byte = field);
    record
}
