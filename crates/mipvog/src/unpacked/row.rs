//! Tensors to be written, and the header of a safetensors file of them.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::base::bytes::Digest;
use crate::base::error::{Error, ErrorKind, Place, Result};

/// A tensor to be written, in the order of its bytes.
#[derive(Debug, Clone)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// `U8`, `F32` or `F64`, as safetensors names them.
    pub dtype: &'static str,
    /// Sizes of its axes.
    pub shape: Vec<usize>,
    /// Bytes of its values.
    pub bytes: u64,
}

impl Row {
    /// A tensor; its type and shape determine its bytes.
    ///
    /// # Errors
    ///
    /// `Overflow` for more bytes than can be counted.
    pub fn new(name: String, dtype: &'static str, shape: &[usize]) -> Result<Self> {
        let size = match dtype {
            "U8" => 1,
            "F64" => 8,
            _ => 4,
        };
        let bytes = shape.iter().try_fold(size, |bytes: u64, &n| bytes.checked_mul(n as u64));
        let overflow =
            || Error::new(ErrorKind::Overflow { what: "tensor" }, Place::Tensor(name.clone()));
        let bytes = bytes.ok_or_else(overflow)?;
        Ok(Self { name, dtype, shape: shape.to_vec(), bytes })
    }

    /// Its element type as NumPy names it.
    pub fn numpy_type(&self) -> &'static str {
        match self.dtype {
            "U8" => "|u1",
            "F64" => "<f8",
            _ => "<f4",
        }
    }
}

/// The header of a safetensors file that holds `texts` and then the bytes of `rows`. The file
/// starts with the number of its bytes, in eight bytes of its own.
pub fn safetensors_header(texts: &BTreeMap<&str, String>, rows: &[Row]) -> String {
    let mut entries = serde_json::Map::new();
    entries.insert("__metadata__".to_owned(), json!(texts));
    let mut at = 0;
    for row in rows {
        let offsets = [at, at + row.bytes];
        at += row.bytes;
        let entry = json!({ "dtype": row.dtype, "shape": row.shape, "data_offsets": offsets });
        entries.insert(row.name.clone(), entry);
    }
    let mut text = Value::Object(entries).to_string();
    // Readers expect the data at a multiple of 8; the format pads with spaces.
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(8) - text.len()));
    text
}

/// The digest of a safetensors file with this header.
pub fn safetensors_digest(header: &[u8]) -> [u8; 32] {
    let mut digest = Digest::new("safetensors");
    digest.bytes(header);
    digest.finish()
}
