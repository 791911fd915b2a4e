//! An open file of tensors, and the ways to write one.

use std::sync::Arc;

use super::value::Value;
use crate::base::bytes::SourceFile;

/// A file of named tensors, opened: its structure is known, no tensor was read.
#[derive(Debug, Clone)]
pub struct TensorFile {
    /// Format of the file.
    pub kind: FileKind,
    /// Contents of the file.
    pub root: Value,
    /// True if the digest holds checksums of all values.
    pub has_checksums: bool,
    /// SHA-256 that stands for its content: for archives that of the directory (names, sizes,
    /// checksums) with the pickle or array headers, for safetensors the header.
    pub digest: [u8; 32],
    /// The open file.
    pub file: Arc<SourceFile>,
}

impl TensorFile {
    /// A setting: a value of the file, or among the texts of a safetensors file.
    pub fn setting(&self, key: &str) -> Option<&Value> {
        self.root.get(key).or_else(|| self.root.at(&["__metadata__", key]))
    }

    /// A text of `__metadata__`, which is a dictionary in safetensors and a prefix in NumPy
    /// archives.
    pub fn metadata(&self, name: &str) -> Option<&str> {
        let nested = self.root.at(&["__metadata__", name]);
        match nested.or_else(|| self.root.get(&format!("__metadata__.{name}"))) {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// The metadata of the container that the file was unpacked from, as a text. It identifies
    /// unpacked containers.
    pub fn unpacked_metadata(&self) -> Option<&str> {
        self.metadata("mipvog")
    }
}

/// Formats of tensor files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum FileKind {
    /// A zip archive of a pickle and storages, as `torch.save` writes since 1.6.
    Torch,
    /// A safetensors file: a JSON header, then tensors.
    Safetensors,
    /// A zip archive of NumPy arrays, stored or deflated.
    Npz,
    /// A JSON description of a folder of pictures.
    Folder,
    /// A MessagePack document, plain or compressed with zlib or gzip.
    Msgpack,
    /// An OpenVDB file.
    Vdb,
    /// A NanoVDB file.
    NanoVdb,
    /// A PLY file.
    Ply,
}

impl FileKind {
    /// Its name, as people know it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Torch => "PyTorch checkpoint",
            Self::Safetensors => "safetensors",
            Self::Npz => "NumPy archive",
            Self::Folder => "asset folder",
            Self::Msgpack => "snapshot",
            Self::Vdb => "OpenVDB file",
            Self::NanoVdb => "NanoVDB file",
            Self::Ply => "PLY file",
        }
    }
}
