//! The start of an OpenVDB file: metadata, and the name, type and place of each grid.
//!
//! ```text
//! i64 "BDV ", u32 file version, u32 library version x 2, u8 has offsets, 36 characters of a uuid,
//! metadata, i32 grids, and for each grid: name, type, instance parent, i64 x 3: grid, blocks, end
//!
//! text      u32 length, bytes
//! metadata  u32 count, and for each: name, type, u32 length, bytes
//! ```
//!
//! All numbers are little-endian. Trees and their values are read by [`crate::vdb`].

use std::sync::Arc;

use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::value::Value;
use crate::base::bytes::{ByteReader, SourceFile};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::{self, LimitName, Limits};

/// Supported file versions: from compressed nodes on, to today's.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;
/// Bytes at the start that are read first; more for longer metadata.
const FIRST_BYTES: u64 = 1 << 16;
/// Maximum length of names and texts.
const LONGEST_TEXT: u32 = 1 << 24;
/// The key of the list of grids.
pub const GRIDS: &str = "grids";

/// Opens such a file.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let mut grid_entries = Vec::new();
    let (metadata, descriptors) = start(file, limits)?;
    for grid in descriptors {
        let (range, blocks) = (grid.range, grid.blocks);
        let numbers = [("start", range[0]), ("blocks", blocks), ("end", range[1])];
        #[expect(clippy::cast_possible_wrap, reason = "places lie in the file")]
        let numbers = numbers.map(|(key, at)| (key.to_owned(), Value::Int(at as i64)));
        let mut entry = vec![("type".to_owned(), Value::Text(grid.kind))];
        entry.extend(grid.parent.map(|parent| ("parent".to_owned(), Value::Text(parent))));
        entry.extend(numbers);
        grid_entries.push((grid.name, Value::Dict(entry)));
    }
    let mut root = vec![(GRIDS.to_owned(), Value::Dict(grid_entries))];
    root.extend(metadata.into_iter().map(|(name, text)| (name, Value::Text(text))));
    let mut digest = Digest::new("vdb");
    file.for_each_piece(|piece| {
        digest.bytes(piece);
        Ok(())
    })?;
    let (kind, root) = (FileKind::Vdb, Value::Dict(root));
    let (digest, file) = (digest.finish(), Arc::clone(file));
    Ok(TensorFile { kind, root, has_checksums: true, digest, file })
}

/// A grid's place in the file.
#[derive(Debug)]
struct Descriptor {
    name: String,
    kind: String,
    /// The grid whose tree it shares, if any.
    parent: Option<String>,
    range: [u64; 2],
    blocks: u64,
}

/// Texts of the file's metadata, by name.
type Texts = Vec<(String, String)>;

/// The file's metadata, and its grids: the next descriptor follows a grid's end.
fn start(file: &Arc<SourceFile>, limits: &Limits) -> Result<(Texts, Vec<Descriptor>)> {
    let (texts, count, mut at) = parsed(file, 0, limits, |reader| {
        let (metadata, count) = header(reader, limits)?;
        Ok((metadata, count, reader.offset()))
    })?;
    let mut grids = Vec::new();
    for _ in 0..count {
        let grid = parsed(file, at, limits, |reader| descriptor(reader, file.length()))?;
        at = grid.range[1];
        grids.push(grid);
    }
    Ok((texts, grids))
}

/// Parses data of unknown length from `at`.
fn parsed<T>(
    file: &SourceFile,
    at: u64,
    limits: &Limits,
    parse: impl Fn(&mut ByteReader) -> Result<T>,
) -> Result<T> {
    let left = file.length().saturating_sub(at);
    let most = left.min(limits.header_bytes);
    let mut count = FIRST_BYTES.min(most);
    loop {
        let bytes = file.read(at, count, count)?;
        let found = parse(&mut ByteReader::new(&bytes, at));
        let is_cut = matches!(&found, Err(error)
            if matches!(error.kind(), ErrorKind::Truncated { .. }));
        if !is_cut || count == most {
            return found;
        }
        count = count.saturating_mul(8).min(most);
    }
}

/// The file's metadata, and the count of grids.
fn header(reader: &mut ByteReader, limits: &Limits) -> Result<(Texts, u32)> {
    reader.array::<8>()?;
    let (place, version) = (reader.place(), reader.u32()?);
    if !VERSIONS.contains(&version) {
        let expected = "222 to 225: open the file in Blender or Houdini and save it again";
        return Err(Error::unsupported(place, format!("file version {version}"), expected));
    }
    reader.array::<8>()?;
    if reader.u8()? != 1 {
        let expected = "a file with offsets, as programs write it to disk";
        return Err(Error::unsupported(place, "a stream of grids", expected));
    }
    reader.array::<36>()?;
    let metadata = read_metadata(reader, limits)?;
    let (place, count) = (reader.place(), reader.u32()?);
    limits::check(LimitName::Entries, "grids", count.into(), limits.entries, &place)?;
    let texts = metadata.into_iter().filter_map(|(name, value)| Some((name, value.text()?)));
    Ok((texts.collect(), count))
}

fn descriptor(reader: &mut ByteReader, length: u64) -> Result<Descriptor> {
    let name = read_text(reader)?;
    // Further grids of the same name have a separator and a number.
    let bare = |name: &str| name.split('\u{1e}').next().unwrap_or_default().to_owned();
    let name = bare(&name);
    let kind = read_text(reader)?;
    let (place, parent) = (reader.place(), read_text(reader)?);
    let [start, stated, end] = [reader.u64()?, reader.u64()?, reader.u64()?];
    let parent = (!parent.is_empty()).then(|| bare(&parent));
    // A grid without a tree has no blocks.
    let blocks = if parent.is_some() { end } else { stated };
    if start != reader.offset() || start > blocks || blocks > end || end > length {
        let found = format!("grid {name:?} from {start} over {blocks} to {end}");
        let expected = format!("ascending places from {} to {length}", reader.offset());
        return Err(Error::malformed(place, found, expected));
    }
    Ok(Descriptor { name, kind, parent, range: [start, end], blocks })
}

/// A value of metadata.
#[derive(Debug, Clone, PartialEq)]
pub enum VdbValue {
    /// A text.
    Text(String),
    /// A truth.
    Bool(bool),
    /// A number.
    Float(f32),
    /// Of any other type.
    Other,
}

impl VdbValue {
    fn text(self) -> Option<String> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// Metadata, in the order of the file.
///
/// # Errors
/// `Truncated` and `Malformed`.
pub fn read_metadata(reader: &mut ByteReader, limits: &Limits) -> Result<Vec<(String, VdbValue)>> {
    let (place, count) = (reader.place(), reader.u32()?);
    limits::check(LimitName::Entries, "values of metadata", count.into(), limits.entries, &place)?;
    let mut values = Vec::new();
    for _ in 0..count {
        let (name, kind, length) = (read_text(reader)?, read_text(reader)?, reader.u32()?);
        let bytes = reader.take(usize::try_from(length).unwrap_or(usize::MAX))?;
        let value = match (kind.as_str(), bytes) {
            ("string", bytes) => VdbValue::Text(String::from_utf8_lossy(bytes).into_owned()),
            ("bool", &[value]) => VdbValue::Bool(value != 0),
            ("float", &[a, b, c, d]) => VdbValue::Float(f32::from_le_bytes([a, b, c, d])),
            _ => VdbValue::Other,
        };
        values.push((name, value));
    }
    Ok(values)
}

/// A text with its length before it.
///
/// # Errors
/// `Truncated` and `Malformed`.
pub fn read_text(reader: &mut ByteReader) -> Result<String> {
    let (place, length) = (reader.place(), reader.u32()?);
    if length > LONGEST_TEXT {
        let found = format!("a text of {length} bytes");
        return Err(Error::malformed(place, found, "a shorter one"));
    }
    let bytes = reader.take(usize::try_from(length).unwrap_or(usize::MAX))?;
    Ok(String::from_utf8_lossy(bytes).into_owned())
}
