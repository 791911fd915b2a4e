//! safetensors: eight bytes of header length, a JSON object, then the tensors' bytes.
//!
//! ```text
//! {"__metadata__": {text: text}, NAME: {"dtype": "F32", "shape": [..], "data_offsets": [a, b]}}
//! ```
//!
//! Strict, as the format asks: no name twice, ranges that follow each other without a hole from
//! the header's end to the file's, each as long as its shape says.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use serde::Deserialize;
use serde::de::{MapAccess, Visitor};

use super::array::Tensor;
use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::value::Value;
use super::zip::Data;
use crate::base::bytes::{ByteReader, SourceFile, Storage};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Limits};
use crate::model::grid::Element;

/// Bytes before the header.
const PREFIX: u64 = 8;

/// The header's key for texts.
const METADATA: &str = "__metadata__";

/// Opens a safetensors file: reads its header.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let prefix = file.read(0, PREFIX, PREFIX)?;
    let length = ByteReader::new(&prefix, 0).u64()?;
    let bytes = file.read(PREFIX, length, limits.header_bytes)?;
    let header: Header = serde_json::from_slice(&bytes).map_err(|error| {
        let found = format!("a header that is not a safetensors one ({error})");
        Error::malformed(Place::Offset(PREFIX), found, "a JSON object of tensors")
    })?;
    limits::check("tensors", header.tensors.len() as u64, limits.entries, &Place::Offset(PREFIX))?;
    let start = PREFIX + length;
    check_ranges(&header, file.length() - start)?;

    let mut root = Vec::with_capacity(header.tensors.len() + 1);
    if let Some(texts) = header.metadata {
        let texts = texts.0.into_iter().map(|(key, text)| (key, Value::Text(text))).collect();
        root.push((METADATA.into(), Value::Dict(texts)));
    }
    for (name, described) in header.tensors {
        let element = element(&described.dtype, &name)?;
        let [from, to] = described.data_offsets;
        let range = start + from..start + to;
        let data = Data::Stored(Storage::File { file: Arc::clone(file), range, crc32: None });
        let tensor = Tensor::dense(name.clone(), element, described.shape, data)?;
        if tensor.bytes() != to - from {
            return Err(Error::malformed(
                tensor.place(),
                format!("{} bytes", to - from),
                format!("{} for its shape {:?}", tensor.bytes(), tensor.shape()),
            ));
        }
        root.push((name, Value::Tensor(tensor)));
    }
    let mut digest = Digest::new("safetensors");
    digest.bytes(&bytes);
    Ok(TensorFile {
        kind: FileKind::Safetensors,
        root: Value::Dict(root),
        digest: digest.finish(),
        file: Arc::clone(file),
    })
}

/// Refuses names that come twice, and ranges that leave a hole, overlap, or do not end with the
/// file.
fn check_ranges(header: &Header, length: u64) -> Result<()> {
    let mut names = BTreeSet::new();
    if let Some((name, _)) = header.tensors.iter().find(|(name, _)| !names.insert(name)) {
        let found = "two tensors of this name";
        return Err(Error::malformed(Place::Tensor(name.clone()), found, "one"));
    }
    let mut ranges: Vec<_> =
        header.tensors.iter().map(|(name, t)| (t.data_offsets, name)).collect();
    ranges.sort_unstable();
    let mut end = 0;
    for ([from, to], name) in ranges {
        if from != end || to < from {
            let found = format!("data from {from} to {to}");
            let expected = format!("data from {end}, where the tensor before it ends");
            return Err(Error::malformed(Place::Tensor(name.clone()), found, expected));
        }
        end = to;
    }
    if end > length {
        return Err(Error::new(ErrorKind::Truncated { wanted: end, left: length }, Place::File));
    }
    if end < length {
        let found = format!("{} bytes after the last tensor", length - end);
        return Err(Error::malformed(Place::File, found, "none"));
    }
    Ok(())
}

fn element(dtype: &str, name: &str) -> Result<Element> {
    Ok(match dtype {
        "F16" => Element::F16,
        "BF16" => Element::BF16,
        "F32" => Element::F32,
        "F64" => Element::F64,
        "BOOL" => Element::Bool,
        "U8" => Element::U8,
        "I8" => Element::I8,
        "I16" => Element::I16,
        "I32" => Element::I32,
        "I64" => Element::I64,
        _ => {
            return Err(Error::unsupported(
                Place::Tensor(name.into()),
                format!("element type {dtype:?}"),
                "F16, BF16, F32, F64, BOOL, U8 or I8 to I64",
            ));
        }
    })
}

/// The header, every key as it comes.
struct Header {
    metadata: Option<Texts>,
    tensors: Vec<(String, Described)>,
}

/// Texts by key, in order.
struct Texts(Vec<(String, String)>);

/// A tensor's description.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    dtype: String,
    shape: Vec<u64>,
    data_offsets: [u64; 2],
}

impl<'de> Deserialize<'de> for Header {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = Header;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of tensors")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Header, A::Error> {
                let mut header = Header { metadata: None, tensors: Vec::new() };
                while let Some(name) = map.next_key::<String>()? {
                    if name != METADATA {
                        header.tensors.push((name, map.next_value()?));
                    } else if header.metadata.replace(map.next_value()?).is_some() {
                        return Err(serde::de::Error::custom("two texts of metadata"));
                    }
                }
                Ok(header)
            }
        }
        from.deserialize_map(Entries)
    }
}

impl<'de> Deserialize<'de> for Texts {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = Texts;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of texts")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Texts, A::Error> {
                let mut texts: Vec<(String, String)> = Vec::new();
                let mut keys = BTreeSet::new();
                while let Some((key, text)) = map.next_entry::<String, String>()? {
                    if !keys.insert(key.clone()) {
                        return Err(serde::de::Error::custom(format!("key {key:?} twice")));
                    }
                    texts.push((key, text));
                }
                Ok(Texts(texts))
            }
        }
        from.deserialize_map(Entries)
    }
}
