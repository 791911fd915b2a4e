//! The header of a PLY file: its comments, and the place and type of each number of a vertex.
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! comment NAME VALUES
//! element vertex COUNT
//! property TYPE NAME        and so on: the numbers of each vertex, one after the other
//! end_header
//! ```

use std::sync::Arc;

use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::value::{Value, check_name};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName, Limits};

/// The first bytes of such a file.
const MAGIC: &[u8] = b"ply";
/// Maximum bytes that are searched for the names of properties.
const LOOKED_THROUGH: u64 = 1 << 13;
/// Maximum length of a header.
const LONGEST: u64 = 1 << 16;
/// The line after which vertices begin.
const END: &[u8] = b"end_header\n";

/// True for a file of Gaussian splats, whose header names their colours.
pub(super) fn is_splats(file: &SourceFile) -> Result<bool> {
    names(file, ["f_dc_0", "rot_0"])
}

/// True for a file of SVRaster's voxels.
pub(super) fn is_voxels(file: &SourceFile) -> Result<bool> {
    names(file, ["octlevel", "grid0_value"])
}

/// True for a PLY file whose header has these words.
fn names(file: &SourceFile, words: [&str; 2]) -> Result<bool> {
    let count = file.length().min(LOOKED_THROUGH);
    let start = file.read(0, count, count)?;
    let names = |word: &str| start.windows(word.len()).any(|window| window == word.as_bytes());
    Ok(start.starts_with(MAGIC) && words.into_iter().all(names))
}

/// Opens such a file. The values are `comments` (name to text), `count`, `start` (the first byte of
/// vertices), `stride` (bytes of a vertex), and `properties` (name to its type and first byte).
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let bytes = file.read(0, file.length().min(LONGEST), LONGEST)?;
    let end = bytes.windows(END.len()).position(|window| window == END);
    let header = end.and_then(|end| bytes.get(..end)).ok_or_else(|| {
        Error::malformed(
            Place::File,
            "a PLY file without end_header",
            "one in its first 65536 bytes",
        )
    })?;
    let start = (header.len() + END.len()) as u64;
    let mut digest = Digest::new("ply");
    digest.bytes(header);
    digest.raw(&file.length().to_le_bytes());
    let header = Header::parse(&String::from_utf8_lossy(header), limits)?;
    let expected = header.count.checked_mul(header.stride).and_then(|size| size.checked_add(start));
    if expected.is_none_or(|expected| expected > file.length()) {
        let wanted = header.count.saturating_mul(header.stride);
        let left = file.length().saturating_sub(start);
        let kind = ErrorKind::Truncated { wanted, left };
        return Err(Error::new(kind, Place::Offset(start)));
    }
    let (kind, root) = (FileKind::Ply, header.root(start));
    let (digest, file) = (digest.finish(), Arc::clone(file));
    Ok(TensorFile { kind, root, has_checksums: false, digest, file })
}

/// The content of the lines.
#[derive(Default)]
struct Header {
    comments: Vec<(String, Value)>,
    properties: Vec<(String, Value)>,
    count: u64,
    stride: u64,
}

impl Header {
    fn parse(text: &str, limits: &Limits) -> Result<Self> {
        let mut header = Self::default();
        let mut elements = 0;
        for (number, line) in (1u64..).zip(text.lines()) {
            limits::check(LimitName::Entries, "lines", number, limits.entries, &Place::File)?;
            let malformed = |expected: &str| {
                let place = Place::Line(number);
                Err(Error::malformed(place, format!("{:?}", shown(line)), expected))
            };
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["format", "binary_little_endian", "1.0"] | ["ply" | "obj_info", ..] | [] => {}
                ["format", ..] => {
                    let place = Place::Key("format".to_owned());
                    let expected = "binary_little_endian 1.0";
                    return Err(Error::unsupported(place, shown(line), expected));
                }
                ["comment", name, ..] => {
                    check_name(name.len(), &Place::File)?;
                    let text = line.split_once(name).map_or("", |(_, rest)| rest.trim());
                    header.comments.push(((*name).to_owned(), Value::Text(text.to_owned())));
                }
                ["comment"] => {}
                ["element", "vertex", count] if elements == 0 => {
                    elements += 1;
                    match count.parse() {
                        Ok(count) => header.count = count,
                        Err(_) => return malformed("a count of vertices"),
                    }
                }
                ["element", ..] => return malformed("vertices alone"),
                ["property", kind, name] if elements == 1 => {
                    let Some(size) = size(kind) else { return malformed("a number") };
                    check_name(name.len(), &Place::File)?;
                    let entry = vec![
                        ("type".to_owned(), Value::Text((*kind).to_owned())),
                        ("at".to_owned(), int(header.stride)),
                    ];
                    header.properties.push(((*name).to_owned(), Value::Dict(entry)));
                    header.stride += size;
                }
                _ => return malformed("a line of a PLY header"),
            }
        }
        if header.stride == 0 {
            return Err(Error::malformed(Place::File, "a PLY file without vertices", "some"));
        }
        Ok(header)
    }

    fn root(self, start: u64) -> Value {
        Value::Dict(vec![
            ("comments".to_owned(), Value::Dict(self.comments)),
            ("properties".to_owned(), Value::Dict(self.properties)),
            ("count".to_owned(), int(self.count)),
            ("start".to_owned(), int(start)),
            ("stride".to_owned(), int(self.stride)),
        ])
    }
}

fn int(number: u64) -> Value {
    Value::Int(i64::try_from(number).unwrap_or(i64::MAX))
}

/// Bytes of a number of this type.
fn size(kind: &str) -> Option<u64> {
    match kind {
        "char" | "uchar" | "int8" | "uint8" => Some(1),
        "short" | "ushort" | "int16" | "uint16" => Some(2),
        "int" | "uint" | "int32" | "uint32" | "float" | "float32" => Some(4),
        "double" | "float64" => Some(8),
        _ => None,
    }
}

fn shown(line: &str) -> String {
    line.chars().take(80).collect()
}
