//! The binary form of glTF: header and chunks, read and written.

use std::ops::Range;

use crate::base::bytes::{ByteReader, ByteSink, Output, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};

/// First bytes of every GLB.
pub const MAGIC: [u8; 4] = *b"glTF";
/// The only supported version of the binary form.
const VERSION: u32 = 2;
const HEADER_BYTES: u64 = 12;
const CHUNK_HEADER_BYTES: u64 = 8;
const JSON: [u8; 4] = *b"JSON";
const BIN: [u8; 4] = *b"BIN\0";

/// The chunks of a GLB beside its document, as offsets in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chunks {
    /// Bytes of the chunk BIN, with its padding, if there is one.
    pub bin: Option<Range<u64>>,
    /// All chunks after it, headers and padding included.
    pub others: Range<u64>,
    /// Bytes behind the stated end, which are unused.
    pub behind: u64,
}

/// Some of the bytes of a chunk.
#[derive(Debug)]
pub enum Piece {
    /// In memory.
    Bytes(Vec<u8>),
    /// All of a file, or of a part of one.
    File(SourceFile),
}

impl Piece {
    /// Its bytes.
    pub fn length(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::File(file) => file.length(),
        }
    }
}

/// The place of the document and of the other chunks.
pub fn read(file: &SourceFile) -> Result<(Range<u64>, Chunks)> {
    let header = file.read(0, HEADER_BYTES, HEADER_BYTES)?;
    let mut reader = ByteReader::new(&header, 0);
    reader.take(MAGIC.len())?;
    let version = reader.u32()?;
    if version != VERSION {
        let found = format!("version {version} of GLB");
        return Err(Error::unsupported(Place::Offset(4), found, "version 2"));
    }
    let length = u64::from(reader.u32()?);
    if length > file.length() {
        let kind = ErrorKind::Truncated { wanted: length, left: file.length() };
        return Err(Error::new(kind, Place::File));
    }
    let (kind, json) = chunk(file, HEADER_BYTES, length)?;
    if kind != JSON {
        let found = format!("a chunk {} first", kind.escape_ascii());
        return Err(Error::malformed(Place::Offset(HEADER_BYTES), found, "the chunk JSON"));
    }
    let behind = file.length() - length;
    let mut chunks = Chunks { bin: None, others: json.end..length, behind };
    let mut at = json.end;
    while at < length {
        let (kind, bytes) = chunk(file, at, length)?;
        match kind {
            BIN if at == json.end => {
                chunks.others.start = bytes.end;
                chunks.bin = Some(bytes.clone());
            }
            JSON | BIN => {
                let found = format!("a chunk {} out of place", kind.escape_ascii());
                let expected = "JSON first, then BIN if there is one, then others";
                return Err(Error::malformed(Place::Offset(at), found, expected));
            }
            _ => {}
        }
        at = bytes.end;
    }
    Ok((json, chunks))
}

/// Type and bytes of the chunk whose header is at `at`, in a GLB that ends at `end`.
fn chunk(file: &SourceFile, at: u64, end: u64) -> Result<([u8; 4], Range<u64>)> {
    let header = file.read(at, CHUNK_HEADER_BYTES, CHUNK_HEADER_BYTES)?;
    let mut reader = ByteReader::new(&header, at);
    let length = u64::from(reader.u32()?);
    let start = at + CHUNK_HEADER_BYTES;
    let left = end.saturating_sub(start);
    if length > left {
        return Err(Error::new(ErrorKind::Truncated { wanted: length, left }, Place::Offset(at)));
    }
    if !length.is_multiple_of(4) {
        let found = format!("a chunk of {length} bytes");
        return Err(Error::malformed(Place::Offset(at), found, "a multiple of 4"));
    }
    Ok((reader.array()?, start..start + length))
}

/// The length of a chunk that holds `length` bytes and their padding.
pub fn padded(length: u64) -> u64 {
    length.next_multiple_of(4)
}

/// Writes a GLB, complete but not yet finished: the document, a chunk BIN if `bin` has any pieces,
/// and other chunks unchanged.
pub fn write_glb(
    document: &str,
    bin: &[Piece],
    others: Option<&SourceFile>,
    output: &mut Output,
) -> Result<()> {
    let document = document.trim_end_matches(' ');
    let json_length = padded(document.len() as u64);
    let bin_length = padded(bin.iter().map(Piece::length).sum());
    let bin_bytes = if bin.is_empty() { 0 } else { CHUNK_HEADER_BYTES + bin_length };
    let others_length = others.map_or(0, SourceFile::length);
    let total = HEADER_BYTES + CHUNK_HEADER_BYTES + json_length + bin_bytes + others_length;
    if total > u32::MAX.into() {
        let expected = "at most 4 GiB, or external, which names the container by a URI";
        return Err(Error::invalid_option("external", format!("a GLB of {total} bytes"), expected));
    }
    output.append(&MAGIC)?;
    output.append(&VERSION.to_le_bytes())?;
    output.append(&number(total)?)?;
    output.append(&number(json_length)?)?;
    output.append(&JSON)?;
    output.append(document.as_bytes())?;
    let padding = document.len().next_multiple_of(4) - document.len();
    output.append(b"   ".get(..padding).unwrap_or_default())?;
    if !bin.is_empty() {
        output.append(&number(bin_length)?)?;
        output.append(&BIN)?;
        for piece in bin {
            match piece {
                Piece::Bytes(bytes) => output.append(bytes)?,
                Piece::File(file) => file.for_each_piece(|bytes| output.append(bytes))?,
            }
        }
        output.pad(4)?;
    }
    others.map_or(Ok(()), |others| others.for_each_piece(|bytes| output.append(bytes)))
}

fn number(length: u64) -> Result<[u8; 4]> {
    let short = u32::try_from(length);
    let overflow = |_| Error::new(ErrorKind::Overflow { what: "GLB" }, Place::File);
    short.map(u32::to_le_bytes).map_err(overflow)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glb_that_is_too_large_is_refused_before_anything_is_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("large");
        // A sparse file, which takes no disk space.
        let large = std::fs::File::create(&path).and_then(|file| file.set_len(1 << 32));
        large.expect("a sparse file");
        let bin = [Piece::File(SourceFile::open(&path).expect("a file"))];
        let mut output = Output::create(&folder.path().join("x.glb"), false).expect("writable");
        let error = write_glb("{}", &bin, None, &mut output).expect_err("too large");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
        assert_eq!(output.length(), 0);
    }
}
