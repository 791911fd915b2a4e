//! JSON texts that describe a folder of assets, such as SNeRG's `scene_params.json`.
//!
//! The values are those of the text. Tables of numbers are tensors in memory, float64. The pictures
//! beside the text are left to the reader of the family.

use std::sync::Arc;

use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::table::list;
use super::value::{Value, joined_name};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::text::quoted_numbers;

/// Longer texts do not describe a folder, because its values are in pictures.
const LONGEST: u64 = 4 << 20;
/// Keys of texts that describe an atlas of pictures, or else planes.
const KEYS: [&str; 2] = ["\"atlas_width\"", "\"num_slices\""];
const PLANES: &str = "\"triplane_resolution\"";

/// True for a JSON text that describes a folder of assets.
///
/// # Errors
/// If it cannot be read.
pub fn is_parameters(file: &SourceFile) -> Result<bool> {
    let start = file.read(0, file.length().min(64), 64)?;
    let first = start.iter().find(|byte| !byte.is_ascii_whitespace());
    if first != Some(&b'{') || file.length() > LONGEST {
        return Ok(false);
    }
    let bytes = file.read(0, file.length(), LONGEST)?;
    let has = |key: &str| bytes.windows(key.len()).any(|window| window == key.as_bytes());
    Ok(has(PLANES) || KEYS.into_iter().all(has))
}

/// Opens such a text.
pub(super) fn open(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let json: serde_json::Value =
        serde_json::from_str(&quoted_numbers(&text)).map_err(|error| {
            let place = Place::Key(format!("line {}", error.line()));
            Error::malformed(place, error.to_string(), "a JSON object of parameters")
        })?;
    let mut digest = Digest::new("parameters");
    digest.bytes(&bytes);
    let mut left = limits.entries;
    let root = value(String::new(), json, &mut left)?;
    let (kind, digest) = (FileKind::Folder, digest.finish());
    Ok(TensorFile { kind, root, has_checksums: false, digest, file: Arc::clone(file) })
}

/// A value of the text. `left` counts the values that may still come.
fn value(key: String, json: serde_json::Value, left: &mut u64) -> Result<Value> {
    limits::check(LimitName::Entries, "values", 1, *left, &Place::File)?;
    *left -= 1;
    Ok(match json {
        serde_json::Value::Null => Value::None,
        serde_json::Value::Bool(value) => Value::Bool(value),
        serde_json::Value::Number(number) => match number.as_i64() {
            Some(value) => Value::Int(value),
            None => Value::Float(number.as_f64().unwrap_or(f64::NAN)),
        },
        serde_json::Value::String(text) => Value::Text(text),
        serde_json::Value::Array(items) => {
            let items = items.into_iter().map(|item| value(String::new(), item, left));
            list(key, items.collect::<Result<_>>()?)?
        }
        serde_json::Value::Object(members) => {
            let entries = members.into_iter().map(|(name, member)| {
                let path = joined_name(&key, &name, &Place::File)?;
                Ok((name, value(path, member, left)?))
            });
            Value::Dict(entries.collect::<Result<_>>()?)
        }
    })
}
