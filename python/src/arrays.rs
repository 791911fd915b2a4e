//! Arrays of Python as an input: a safetensors file whose values are read where they lie.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use mipvog::base::bytes::{ReadAt, SourceFile};
use mipvog_inputs::tensor::{Row, safetensors_header};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The name of arrays in messages and reports.
const NAME: &str = "arrays";

/// A name, an element type as safetensors names it, a shape, and bytes in one piece or several.
type PyTensor<'py> = (String, String, Vec<usize>, Vec<Bound<'py, PyArray1<u8>>>);

/// Arrays and texts under the names of a safetensors file.
#[pyclass(frozen, module = "mipvog_bake._native")]
#[derive(Debug)]
pub struct Arrays {
    held: Arc<Held>,
}

/// A safetensors file: its start, then the bytes of each array.
struct Held {
    /// Length, header.
    start: Vec<u8>,
    /// The bytes of an array, and their offset in the file.
    parts: Vec<(u64, Py<PyArray1<u8>>)>,
    length: u64,
    /// Each array's name, type, shape, and number of parts; the texts.
    tensors: Vec<(String, &'static str, Vec<usize>, usize)>,
    texts: BTreeMap<String, String>,
}

impl fmt::Debug for Held {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} arrays of {} bytes", self.parts.len(), self.length)
    }
}

impl ReadAt for Held {
    fn length(&self) -> std::io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, mut offset: u64, mut out: &mut [u8]) -> std::io::Result<()> {
        if let Some(start) = self.start.get(offset as usize..) {
            let count = start.len().min(out.len());
            let (here, rest) = out.split_at_mut(count);
            here.copy_from_slice(&start[..count]);
            (out, offset) = (rest, offset + count as u64);
        }
        if out.is_empty() {
            return Ok(());
        }
        // The lock is taken for a copy of a plane at most.
        Python::attach(|py| {
            let first = self.parts.partition_point(|(at, _)| *at <= offset).saturating_sub(1);
            for (at, part) in &self.parts[first..] {
                let part = part.bind(py).try_readonly().map_err(std::io::Error::other)?;
                let bytes = part.as_slice().map_err(std::io::Error::other)?;
                let from = (offset - at) as usize;
                let count = bytes.len().saturating_sub(from).min(out.len());
                let (here, rest) = std::mem::take(&mut out).split_at_mut(count);
                here.copy_from_slice(&bytes[from..from + count]);
                (out, offset) = (rest, offset + count as u64);
                if out.is_empty() {
                    break;
                }
            }
            Ok(())
        })
    }
}

#[pymethods]
impl Arrays {
    /// Of tensors and texts.
    #[new]
    fn new(tensors: Vec<PyTensor<'_>>, texts: BTreeMap<String, String>) -> Self {
        let (mut rows, mut parts, mut at) = (Vec::new(), Vec::new(), 0);
        let mut named = Vec::new();
        for (name, dtype, shape, pieces) in tensors {
            let bytes = pieces.iter().map(|piece| piece.len() as u64).sum();
            let dtype: &'static str = match dtype.as_str() {
                "F16" => "F16",
                "F64" => "F64",
                "I32" => "I32",
                "I64" => "I64",
                "U8" => "U8",
                _ => "F32",
            };
            named.push((name.clone(), dtype, shape.clone(), pieces.len()));
            rows.push(Row { name, dtype, shape, bytes });
            for piece in pieces {
                parts.push((at, piece.clone().unbind()));
                at += piece.len() as u64;
            }
        }
        let pairs = texts.iter().map(|(key, text)| (key.as_str(), text.clone())).collect();
        let header = safetensors_header(&pairs, &rows);
        let start = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes()].concat();
        parts.iter_mut().for_each(|(at, _)| *at += start.len() as u64);
        let length = at + start.len() as u64;
        Self { held: Arc::new(Held { start, parts, length, tensors: named, texts }) }
    }

    /// The arguments that make the same arrays again, for pickling.
    fn __getnewargs__<'py>(
        &self,
        py: Python<'py>,
    ) -> (Vec<PyTensor<'py>>, BTreeMap<String, String>) {
        let Held { parts, tensors, texts, .. } = &*self.held;
        let mut parts = parts.iter().map(|(_, part)| part.bind(py).clone());
        let tensors = tensors.iter().map(|(name, dtype, shape, count)| {
            let own = parts.by_ref().take(*count).collect();
            (name.clone(), (*dtype).to_owned(), shape.clone(), own)
        });
        (tensors.collect(), texts.clone())
    }
}

impl Arrays {
    /// The arrays as a file.
    pub fn file(&self) -> Arc<SourceFile> {
        let file = SourceFile::held(Arc::clone(&self.held) as _, Path::new(NAME));
        Arc::new(file.expect("the length of arrays is known"))
    }
}
