//! The start of a NanoVDB file: the name, type and place of each grid.
//!
//! ```text
//! segments  u64 magic, u32 version, u16 grids, u16 codec, a header for each grid, then their bytes
//! header    u64 bytes of the grid, u64 bytes in the file, 16 bytes, u32 type, u32 class, 96 bytes,
//!           u32 length of the name, 28 bytes, u16 codec, 6 bytes, the name and a zero
//! raw       grids without segments, as they are in memory
//! version   major << 21 | minor << 10 | patch
//! ```
//!
//! All numbers are little-endian. Grids are read by [`crate::vdb`]. The layout is that of version
//! 32, which NanoVDB has had since 2020; it is written down in `NanoVDB.h`.

use std::sync::Arc;

use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::value::Value;
use super::vdb::GRIDS;
use crate::base::bytes::{ByteReader, SourceFile};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};

/// First bytes of files of any version: the last one distinguishes files from grids in memory.
const MAGIC: &[u8] = b"NanoVDB";
const GRID_MAGIC: &[u8; 8] = b"NanoVDB1";
/// The version of the layout.
const MAJOR: u32 = 32;
/// Bytes of a segment's own header, and of that of a grid.
const SEGMENT_BYTES: u64 = 16;
const HEADER_BYTES: u64 = 176;
/// Bytes of a grid in memory before its tree.
const GRID_BYTES: u64 = 672;
/// Maximum length of names.
const LONGEST_NAME: u64 = 1 << 16;
/// Names of types by their numbers.
const TYPES: [&str; 27] = [
    "Unknown",
    "Float",
    "Double",
    "Int16",
    "Int32",
    "Int64",
    "Vec3f",
    "Vec3d",
    "Mask",
    "Half",
    "UInt32",
    "Boolean",
    "RGBA8",
    "Fp4",
    "Fp8",
    "Fp16",
    "FpN",
    "Vec4f",
    "Vec4d",
    "Index",
    "OnIndex",
    "IndexMask",
    "OnIndexMask",
    "PointIndex",
    "Vec3u8",
    "Vec3u16",
    "UInt8",
];
/// Names of classes by their numbers, as OpenVDB has them.
const CLASSES: [&str; 4] = ["unknown", "level set", "fog volume", "staggered"];
/// Names of codecs by their numbers.
const CODECS: [&str; 3] = ["none", "zip", "blosc"];

/// True for the first bytes of such a file.
pub fn is_nanovdb(start: &[u8]) -> bool {
    start.starts_with(MAGIC)
}

/// Opens such a file.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let start = file.read(0, file.length().min(SEGMENT_BYTES + 4), limits.header_bytes)?;
    let number = |at: usize| start.get(at..at + 4).and_then(|bytes| bytes.first_chunk::<4>());
    let major = |at: usize| number(at).map_or(0, |bytes| u32::from_le_bytes(*bytes) >> 21);
    // A grid in memory has a checksum at the offset of a file's version.
    let is_raw = start.starts_with(GRID_MAGIC) || (major(8) != MAJOR && major(16) == MAJOR);
    let grids = match is_raw {
        true => raw_grids(file, limits)?,
        false => segments(file, limits)?,
    };
    let mut digest = Digest::new("nvdb");
    file.for_each_piece(|piece| {
        digest.bytes(piece);
        Ok(())
    })?;
    let entries = grids.into_iter().map(Descriptor::entry).collect();
    let root = Value::Dict(vec![(GRIDS.to_owned(), Value::Dict(entries))]);
    let (kind, digest, file) = (FileKind::NanoVdb, digest.finish(), Arc::clone(file));
    Ok(TensorFile { kind, root, has_checksums: true, digest, file })
}

/// A grid's place in the file.
#[derive(Debug)]
struct Descriptor {
    name: String,
    kind: String,
    class: &'static str,
    codec: &'static str,
    range: [u64; 2],
    /// Bytes in memory.
    bytes: u64,
}

impl Descriptor {
    /// Its entry in the list of grids.
    fn entry(self) -> (String, Value) {
        let [start, end] = self.range;
        #[expect(clippy::cast_possible_wrap, reason = "places lie in the file, bytes in memory")]
        let numbers = [("start", start), ("end", end), ("bytes", self.bytes)]
            .map(|(key, at)| (key.to_owned(), Value::Int(at as i64)));
        let texts =
            [("type", self.kind), ("class", self.class.into()), ("codec", self.codec.into())]
                .map(|(key, text)| (key.to_owned(), Value::Text(text)));
        (self.name, Value::Dict(texts.into_iter().chain(numbers).collect()))
    }
}

/// The name of a type's number.
fn kind_of(number: u32) -> String {
    let name = usize::try_from(number).ok().and_then(|number| TYPES.get(number));
    name.map_or_else(|| format!("NanoVDB {number}"), |name| format!("NanoVDB {name}"))
}

fn class_of(number: u32) -> &'static str {
    let name = usize::try_from(number).ok().and_then(|number| CLASSES.get(number));
    name.copied().unwrap_or(CLASSES[0])
}

/// Refuses other versions of the layout.
fn check_version(version: u32, place: &Place) -> Result<()> {
    if version >> 21 == MAJOR {
        return Ok(());
    }
    let found = format!("NanoVDB {}.{}", version >> 21, version >> 10 & 0x7ff);
    let error = Error::unsupported(place.clone(), found, "version 32");
    Err(error.advise("write the file again with a NanoVDB of version 32, or as .vdb"))
}

fn segments(file: &SourceFile, limits: &Limits) -> Result<Vec<Descriptor>> {
    let (mut grids, mut at) = (Vec::new(), 0);
    while at < file.length() {
        let bytes = file.read(at, SEGMENT_BYTES, SEGMENT_BYTES)?;
        let mut reader = ByteReader::new(&bytes, at);
        let place = reader.place();
        if !is_nanovdb(&reader.array::<8>()?) {
            let found = "bytes that are no segment".to_owned();
            return Err(Error::malformed(place, found, "a segment of a NanoVDB file"));
        }
        check_version(reader.u32()?, &place)?;
        let [count, codec] = [reader.u16()?, reader.u16()?];
        let Some(codec) = CODECS.get(usize::from(codec)).copied() else {
            let found = format!("codec {codec}");
            return Err(Error::malformed(place, found, "0 to 2: none, zip, blosc"));
        };
        if count == 0 {
            return Err(Error::malformed(place, "a segment without grids", "at least one"));
        }
        at += SEGMENT_BYTES;
        let first = grids.len();
        for _ in 0..count {
            grids.push(header(file, &mut at, codec)?);
        }
        let total = grids.len() as u64;
        limits::check(LimitName::Entries, "grids", total, limits.entries, &place)?;
        // The bytes of all grids follow their headers.
        for grid in grids.iter_mut().skip(first) {
            let [_, length] = grid.range;
            let end = at.checked_add(length).filter(|&end| end <= file.length());
            let Some(end) = end else {
                let found = format!("grid {:?} of {length} bytes from {at}", grid.name);
                let expected = format!("one that ends at {} at most", file.length());
                return Err(Error::malformed(place, found, expected));
            };
            grid.range = [at, end];
            at = end;
        }
    }
    Ok(grids)
}

/// A grid's header; its range is 0 and its length in the file.
fn header(file: &SourceFile, at: &mut u64, codec: &'static str) -> Result<Descriptor> {
    let bytes = file.read(*at, HEADER_BYTES, HEADER_BYTES)?;
    let mut reader = ByteReader::new(&bytes, *at);
    let [bytes, length] = [reader.u64()?, reader.u64()?];
    reader.array::<16>()?;
    let [kind, class] = [reader.u32()?, reader.u32()?];
    reader.array::<96>()?;
    let (place, name_bytes) = (reader.place(), reader.u32()?);
    limits::check_fixed("bytes of a name", name_bytes.into(), LONGEST_NAME, &place)?;
    *at += HEADER_BYTES;
    let name = file.read(*at, name_bytes.into(), LONGEST_NAME)?;
    *at += u64::from(name_bytes);
    let name = text(&name);
    let (kind, class) = (kind_of(kind), class_of(class));
    Ok(Descriptor { name, kind, class, codec, range: [0, length], bytes })
}

/// The text before a zero.
fn text(bytes: &[u8]) -> String {
    let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(text).into_owned()
}

/// Grids in memory layout, one after the other.
fn raw_grids(file: &SourceFile, limits: &Limits) -> Result<Vec<Descriptor>> {
    let (mut grids, mut at) = (Vec::new(), 0);
    while at < file.length() {
        let bytes = file.read(at, GRID_BYTES, GRID_BYTES)?;
        let mut reader = ByteReader::new(&bytes, at);
        let place = reader.place();
        let is_grid = is_nanovdb(&reader.array::<8>()?);
        reader.array::<8>()?;
        let version = reader.u32()?;
        reader.array::<12>()?;
        let length = reader.u64()?;
        let name = text(&reader.array::<256>()?);
        reader.array::<336>()?;
        let [class, kind] = [reader.u32()?, reader.u32()?];
        let end = at.checked_add(length).filter(|&end| end <= file.length());
        let (true, Some(end)) = (is_grid && length >= GRID_BYTES, end) else {
            let found = format!("a grid of {length} bytes");
            let expected = format!("one that ends at {} at most", file.length());
            return Err(Error::malformed(place, found, expected));
        };
        check_version(version, &place)?;
        let (kind, class, codec) = (kind_of(kind), class_of(class), CODECS[0]);
        grids.push(Descriptor { name, kind, class, codec, range: [at, end], bytes: length });
        let total = grids.len() as u64;
        limits::check(LimitName::Entries, "grids", total, limits.entries, &place)?;
        at = end;
    }
    Ok(grids)
}
