//! MessagePack documents, plain or inside of zlib or gzip, as Instant-NGP writes its snapshots.
//!
//! Opening reads everything but binary values, which become tensors of bytes that stay in the file;
//! a packed document is inflated into an unnamed file in the folder for temporary files. Extension
//! types are refused. Stated lengths are never trusted for allocation: strings are checked against
//! the file's length first, and lists and maps grow as their items are read.

use std::io::{ErrorKind as IoError, Read, Write};
use std::sync::Arc;

use flate2::read::{GzDecoder, ZlibDecoder};

use super::array::Tensor;
use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::positioned::Positioned;
use super::table::list;
use super::value::{Value, joined_name};
use super::zip::Data;
use crate::base::bytes::{SourceFile, Storage};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::file_kind::{is_document, start};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::model::grid::Element;

/// Maximum depth of nested lists and maps.
const DEPTH: u32 = 64;
/// Bytes that are read at once.
const PIECE: u64 = 1 << 16;
/// Inflated bytes that identify a document.
const START: usize = 16;

/// The form of a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Plain,
    Zlib,
    Gzip,
}

/// The form of a document with this start: a map whose first key is a word.
pub(super) fn packing(start: &[u8]) -> Option<Packing> {
    let inflated = |decoder: &mut dyn Read| {
        let (mut out, mut count) = ([0; START], 0);
        while let Some(rest) = out.get_mut(count..).filter(|rest| !rest.is_empty()) {
            match decoder.read(rest) {
                Ok(read) if read > 0 => count += read,
                _ => break,
            }
        }
        is_document(out.get(..count).unwrap_or_default())
    };
    match start {
        [0x1f, 0x8b, 8, ..] => inflated(&mut GzDecoder::new(start)).then_some(Packing::Gzip),
        [0x78, flags, ..] if (0x7800 + u32::from(*flags)).is_multiple_of(31) => {
            inflated(&mut ZlibDecoder::new(start)).then_some(Packing::Zlib)
        }
        _ => is_document(start).then_some(Packing::Plain),
    }
}

/// Opens a document.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let packing = packing(&start(file)?).unwrap_or(Packing::Plain);
    let from = Positioned { file: Arc::clone(file), at: 0 };
    let plain = match packing {
        Packing::Plain => Arc::clone(file),
        Packing::Zlib => Arc::new(inflate(file, ZlibDecoder::new(from), limits)?),
        Packing::Gzip => Arc::new(inflate(file, GzDecoder::new(from), limits)?),
    };
    let mut document = Document {
        file: &plain,
        at: 0,
        piece: (0, Vec::new()),
        left: limits.pickle_objects,
        texts: limits.header_bytes,
        budget: Budget::new(limits),
        digest: Digest::new("msgpack"),
    };
    let root = document.value(String::new(), 0)?;
    if document.at < plain.length() {
        let found = format!("{} bytes after the document", plain.length() - document.at);
        return Err(Error::malformed(Place::Offset(document.at), found, "none"));
    }
    let (kind, digest) = (FileKind::Msgpack, document.digest.finish());
    Ok(TensorFile { kind, root, has_checksums: false, digest, file: Arc::clone(file) })
}

/// The document inside a packed file, in an unnamed file.
fn inflate(file: &SourceFile, mut from: impl Read, limits: &Limits) -> Result<SourceFile> {
    let folder = std::env::temp_dir();
    let mut out = tempfile::tempfile().map_err(|error| Error::io(error, &folder))?;
    let (mut budget, mut length) = (Budget::new(limits), 0);
    let mut piece = vec![0; usize::try_from(PIECE).unwrap_or(0)];
    loop {
        let count = match from.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == IoError::Interrupted => continue,
            Err(error) => {
                let found = format!("bytes that do not inflate ({error})");
                return Err(Error::malformed(Place::File, found, "an undamaged snapshot"));
            }
        };
        budget.spend(count as u64, "inflated bytes", &Place::File)?;
        length += count as u64;
        let bytes = piece.get(..count).unwrap_or_default();
        out.write_all(bytes).map_err(|error| Error::io(error, &folder))?;
    }
    Ok(SourceFile::nameless(out, file.path(), length))
}

/// A reader of a document.
struct Document<'a> {
    file: &'a Arc<SourceFile>,
    at: u64,
    /// The bytes that were read last, and the offset of the first one.
    piece: (u64, Vec<u8>),
    /// Remaining allowance of values, and of bytes of texts.
    left: u64,
    texts: u64,
    /// Memory for values.
    budget: Budget,
    digest: Digest,
}

impl Document<'_> {
    /// The next `N` bytes.
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let found = |(start, bytes): &(u64, Vec<u8>), at: u64| {
            let from = usize::try_from(at.checked_sub(*start)?).ok()?;
            bytes.get(from..)?.first_chunk::<N>().copied()
        };
        if found(&self.piece, self.at).is_none() {
            let left = self.file.length().saturating_sub(self.at);
            let count = left.min(PIECE).max(N as u64);
            self.piece = (self.at, self.file.read(self.at, count, PIECE)?);
        }
        let bytes = found(&self.piece, self.at).unwrap_or([0; N]);
        self.at += N as u64;
        self.digest.bytes(&bytes);
        Ok(bytes)
    }

    /// A whole number of `N` bytes.
    fn count<const N: usize>(&mut self) -> Result<u64> {
        let bytes = self.take::<N>()?;
        Ok(bytes.into_iter().fold(0, |sum, byte| sum << 8 | u64::from(byte)))
    }

    fn value(&mut self, key: String, depth: u32) -> Result<Value> {
        let start = self.at;
        limits::check(LimitName::PickleObjects, "values", 1, self.left, &Place::Offset(start))?;
        self.left -= 1;
        // Lists and maps take up to half as much again while they grow.
        let bytes = size_of::<(String, Value)>() as u64 * 3 / 2;
        self.budget.spend(bytes, "bytes of values", &Place::Offset(start))?;
        let [marker] = self.take()?;
        Ok(match marker {
            0..=0x7f => Value::Int(marker.into()),
            0xe0..=0xff => Value::Int(i64::from(marker) - 256),
            0x80..=0x8f => self.map(key, (marker & 15).into(), depth)?,
            0x90..=0x9f => self.items(key, (marker & 15).into(), depth)?,
            0xa0..=0xbf => Value::Text(self.text((marker & 31).into())?),
            0xc0 => Value::None,
            0xc2 | 0xc3 => Value::Bool(marker == 0xc3),
            0xc4 => self.count::<1>().and_then(|length| self.binary(key, length))?,
            0xc5 => self.count::<2>().and_then(|length| self.binary(key, length))?,
            0xc6 => self.count::<4>().and_then(|length| self.binary(key, length))?,
            0xca => Value::Float(f32::from_be_bytes(self.take()?).into()),
            0xcb => Value::Float(f64::from_be_bytes(self.take()?)),
            0xcc => whole(self.count::<1>()?),
            0xcd => whole(self.count::<2>()?),
            0xce => whole(self.count::<4>()?),
            0xcf => whole(self.count::<8>()?),
            0xd0 => Value::Int(i8::from_be_bytes(self.take()?).into()),
            0xd1 => Value::Int(i16::from_be_bytes(self.take()?).into()),
            0xd2 => Value::Int(i32::from_be_bytes(self.take()?).into()),
            0xd3 => Value::Int(i64::from_be_bytes(self.take()?)),
            0xd9 => self.count::<1>().and_then(|length| self.text(length)).map(Value::Text)?,
            0xda => self.count::<2>().and_then(|length| self.text(length)).map(Value::Text)?,
            0xdb => self.count::<4>().and_then(|length| self.text(length)).map(Value::Text)?,
            0xdc => self.count::<2>().and_then(|count| self.items(key, count, depth))?,
            0xdd => self.count::<4>().and_then(|count| self.items(key, count, depth))?,
            0xde => self.count::<2>().and_then(|count| self.map(key, count, depth))?,
            0xdf => self.count::<4>().and_then(|count| self.map(key, count, depth))?,
            0xc7..=0xc9 | 0xd4..=0xd8 => {
                let found = "an extension type of MessagePack";
                let expected = "numbers, texts, lists, maps and binary values";
                return Err(Error::unsupported(Place::Offset(start), found, expected));
            }
            0xc1 => {
                let found = "the byte c1";
                return Err(Error::malformed(Place::Offset(start), found, "a value"));
            }
        })
    }

    fn deeper(&self, depth: u32) -> Result<u32> {
        if depth < DEPTH {
            return Ok(depth + 1);
        }
        let found = format!("more than {DEPTH} lists and maps inside of each other");
        Err(Error::malformed(Place::Offset(self.at), found, "fewer"))
    }

    fn items(&mut self, key: String, count: u64, depth: u32) -> Result<Value> {
        let depth = self.deeper(depth)?;
        let mut items = Vec::new();
        for _ in 0..count {
            items.push(self.value(String::new(), depth)?);
        }
        list(key, items)
    }

    fn map(&mut self, key: String, count: u64, depth: u32) -> Result<Value> {
        let depth = self.deeper(depth)?;
        let mut entries = Vec::new();
        for _ in 0..count {
            let place = Place::Offset(self.at);
            let name = match self.value(String::new(), depth)? {
                Value::Text(name) => name,
                Value::Int(number) => number.to_string(),
                other => {
                    return Err(Error::malformed(place, other.describe(), "a key that is a text"));
                }
            };
            let path = joined_name(&key, &name, &place)?;
            entries.push((name, self.value(path, depth)?));
        }
        Ok(Value::Dict(entries))
    }

    fn text(&mut self, length: u64) -> Result<String> {
        let place = Place::Offset(self.at);
        limits::check(LimitName::HeaderBytes, "bytes of texts", length, self.texts, &place)?;
        let bytes = self.file.read(self.at, length, self.texts)?;
        self.texts -= length;
        self.at += length;
        self.digest.bytes(&bytes);
        String::from_utf8(bytes).map_err(|_| Error::malformed(place, "no UTF-8", "a text in UTF-8"))
    }

    /// A binary value stays in the file.
    fn binary(&mut self, key: String, length: u64) -> Result<Value> {
        let left = self.file.length().saturating_sub(self.at);
        if length > left {
            let kind = ErrorKind::Truncated { wanted: length, left };
            return Err(Error::new(kind, Place::Offset(self.at)));
        }
        let range = self.at..self.at + length;
        self.at = range.end;
        let file = Arc::clone(self.file);
        let data = Data::Stored(Storage::File { file, range, crc32: None });
        Tensor::dense(key, Element::U8, vec![length], data).map(Value::Tensor)
    }
}

/// A number of at least 0.
fn whole(number: u64) -> Value {
    i64::try_from(number).map_or(Value::Float(number as f64), Value::Int)
}
