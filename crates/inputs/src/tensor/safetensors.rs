//! safetensors: eight bytes of header length, a JSON object, then the tensors' bytes.
//!
//! ```text
//! {"__metadata__": {text: text}, NAME: {"dtype": "F32", "shape": [..], "data_offsets": [a, b]}}
//! ```
//!
//! As the format requires, the reader is strict: names are unique, and ranges follow each other
//! without holes from the header's end to the file's, each with the length of its shape.

use std::collections::BTreeSet;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;

use super::array::Tensor;
use super::file::{FileKind, TensorFile};
use super::value::Value;
use super::zip::Data;
use crate::base::bytes::{ByteReader, SourceFile, Storage};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::grid::Element;
use mipvog::unpacked::safetensors_digest;

/// Bytes before the header.
const PREFIX: u64 = 8;

/// The header's key for texts.
const METADATA: &str = "__metadata__";

/// Opens a safetensors file: reads its header.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let prefix = file.read(0, PREFIX, PREFIX)?;
    let length = ByteReader::new(&prefix, 0).u64()?;
    let bytes = file.read(PREFIX, length, limits.header_bytes)?;
    let place = Place::Offset(PREFIX);
    let header: Pairs<&RawValue> = serde_json::from_slice(&bytes).map_err(|error| {
        let found = format!("a header that is not a safetensors one ({error})");
        Error::malformed(place.clone(), found, "a JSON object of tensors")
    })?;
    limits::check(LimitName::Entries, "tensors", header.0.len() as u64, limits.entries, &place)?;
    let (mut root, mut tensors) = (Vec::with_capacity(header.0.len()), Vec::new());
    for (name, raw) in header.0 {
        let malformed = |error: serde_json::Error| {
            let found = format!("a header entry that cannot be read ({error})");
            Error::malformed(Place::Tensor(name.clone()), found, "dtype, shape and data_offsets")
        };
        if name == METADATA {
            let Pairs::<String>(texts) = serde_json::from_str(raw.get()).map_err(malformed)?;
            let texts = texts.into_iter().map(|(key, text)| (key, Value::Text(text))).collect();
            root.push((name, Value::Dict(texts)));
        } else {
            let described: Described = serde_json::from_str(raw.get()).map_err(malformed)?;
            tensors.push((name, described));
        }
    }
    let start = PREFIX + length;
    check_ranges(&tensors, file.length() - start)?;
    for (name, described) in tensors {
        let Some(element) = element(&described.dtype) else {
            let kind = format!("a tensor of dtype {}", described.dtype);
            root.push((name.clone(), Value::Tensor(Tensor::unread(name, described.shape, kind)?)));
            continue;
        };
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
    Ok(TensorFile {
        kind: FileKind::Safetensors,
        has_checksums: false,
        root: Value::Dict(root),
        digest: safetensors_digest(&bytes),
        file: Arc::clone(file),
    })
}

/// Refuses ranges that leave a hole, overlap, or do not end with the file.
fn check_ranges(tensors: &[(String, Described)], length: u64) -> Result<()> {
    let mut ranges: Vec<_> = tensors.iter().map(|(name, t)| (t.data_offsets, name)).collect();
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

/// The supported number type.
fn element(dtype: &str) -> Option<Element> {
    Some(match dtype {
        "F16" => Element::F16,
        "BF16" => Element::BF16,
        "F32" => Element::F32,
        "F64" => Element::F64,
        "BOOL" => Element::Bool,
        "U8" => Element::U8,
        "I8" => Element::I8,
        "I16" => Element::I16,
        "U16" => Element::U16,
        "I32" => Element::I32,
        "I64" => Element::I64,
        _ => return None,
    })
}

/// The description of a tensor.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    dtype: String,
    shape: Vec<u64>,
    data_offsets: [u64; 2],
}

/// The members of an object in order, no name twice.
struct Pairs<V>(Vec<(String, V)>);

impl<'de, V: Deserialize<'de>> Deserialize<'de> for Pairs<V> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        from.deserialize_map(PairsVisitor(PhantomData))
    }
}

struct PairsVisitor<V>(PhantomData<V>);

impl<'de, V: Deserialize<'de>> Visitor<'de> for PairsVisitor<V> {
    type Value = Pairs<V>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Pairs<V>, A::Error> {
        let (mut pairs, mut names) = (Vec::new(), BTreeSet::new());
        while let Some((name, value)) = map.next_entry::<String, V>()? {
            if !names.insert(name.clone()) {
                return Err(serde::de::Error::custom(format!("two tensors or texts {name:?}")));
            }
            pairs.push((name, value));
        }
        Ok(Pairs(pairs))
    }
}
