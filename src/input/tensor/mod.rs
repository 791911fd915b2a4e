//! Files of named tensors: PyTorch's zip files, safetensors, NumPy's npz.
//!
//! This module knows syntax only; what names mean is [`crate::input::checkpoint`]'s matter. A file's kind is
//! told by its content. Opening reads directories, headers and the pickle, never a tensor: each
//! [`Tensor`] says where its bytes lie, checked against the file, and is read by position when
//! someone asks for it. Nothing in a file can run: the pickle is interpreted by `pickle`, which
//! knows only what state dictionaries need.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod array;
mod digest;
mod npz;
mod pickle;
mod safetensors;
mod torch;
mod value;
mod zip;

use std::path::Path;
use std::sync::Arc;

pub use array::Tensor;
pub use value::Value;
pub use zip::{Archive, Data, Entry};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;

/// A file of named tensors, opened: its structure is known, no tensor was read.
#[derive(Debug, Clone)]
pub struct TensorFile {
    /// How the file is written.
    pub kind: FileKind,
    /// What it holds.
    pub root: Value,
    /// SHA-256 of what stands for its content: for archives the directory (names, sizes,
    /// checksums) with the pickle or array headers, for safetensors the header.
    pub digest: [u8; 32],
    /// The open file.
    pub file: Arc<SourceFile>,
}

/// How a file of tensors is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FileKind {
    /// A zip file of a pickle and storages, as `torch.save` writes since 1.6.
    Torch,
    /// A JSON header, then tensors.
    Safetensors,
    /// A zip file of NumPy arrays, stored or deflated.
    Npz,
}

impl FileKind {
    /// Its name, as people know it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Torch => "PyTorch checkpoint",
            Self::Safetensors => "safetensors",
            Self::Npz => "NumPy archive",
        }
    }
}

/// Opens a file of tensors, whatever its name.
///
/// # Errors
/// `Io` where it cannot be read or is a folder, `Unsupported` for files of another kind and for
/// what only a newer reader would know, `Malformed`, `Truncated`, `Checksum` for damaged ones,
/// `OverLimit` for those that ask for too much.
pub fn open(path: &Path, limits: &Limits) -> Result<TensorFile> {
    let file = Arc::new(SourceFile::open(path)?);
    open_file(&file, limits)
}

/// The same for a file of which only the bytes are known.
///
/// # Errors
/// Those of [`open()`].
pub fn open_file(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    open_kind(file, limits).map_err(|error| error.in_file(file.path()))
}

/// Whether a file starts like one of tensors.
///
/// # Errors
/// Where its start cannot be read.
pub fn is_tensors(file: &SourceFile) -> Result<bool> {
    let start = start(file)?;
    Ok(is_zip(&start) || is_safetensors(&start))
}

/// What a file is that is not of tensors, as far as its start tells.
///
/// # Errors
/// Where its start cannot be read.
pub fn describe(file: &SourceFile) -> Result<&'static str> {
    let start = start(file)?;
    Ok(other_format(&start).unwrap_or(match start.as_slice() {
        [] => "an empty file",
        start if is_text(start) => "a text file",
        _ => "a file of unknown kind",
    }))
}

/// As many bytes as tell a file's kind.
fn start(file: &SourceFile) -> Result<Vec<u8>> {
    let count = file.length().min(264);
    file.read(0, count, count)
}

fn is_zip(start: &[u8]) -> bool {
    start.starts_with(b"PK\x03\x04") || start.starts_with(b"PK\x05\x06")
}

/// Eight bytes of header length, then the header, a JSON object.
fn is_safetensors(start: &[u8]) -> bool {
    start.get(8) == Some(&b'{') && !start.get(..8).is_some_and(is_text)
}

fn open_kind(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let start = start(file)?;
    if is_zip(&start) {
        let archive = Arc::new(Archive::open(file, limits)?);
        return match torch::find_pickle(&archive)? {
            Some(root) => torch::open(file, &archive, &root, limits),
            None => npz::open(file, &archive, limits),
        };
    }
    if is_safetensors(&start) {
        return safetensors::open(file, limits);
    }
    let expected = "a PyTorch checkpoint (zip), a .safetensors or an .npz file";
    let found = describe(file)?;
    Err(match other_format(&start) {
        Some(_) => Error::unsupported(Place::File, found, expected),
        None => Error::malformed(Place::File, found, expected),
    })
}

/// Whether bytes are text, if the last character of it may be cut.
fn is_text(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).map_or_else(|error| error.error_len().is_none(), |_| true)
        && !bytes.iter().any(|&byte| byte < b' ' && !b"\t\n\r\x0c".contains(&byte))
}

/// The format of a file that starts so, if it is one that others use for such things.
fn other_format(start: &[u8]) -> Option<&'static str> {
    // The number that torch.save pickled first before version 1.6.
    const LEGACY: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19";
    Some(match start {
        _ if start.starts_with(LEGACY) => {
            "a checkpoint in the format of PyTorch before 1.6 (load and save it again with \
             torch.save of any newer version)"
        }
        _ if start.get(257..262) == Some(b"ustar") => {
            "a tar file (the first checkpoints of PyTorch were; load and save it again with \
             torch.save of a version since 1.6)"
        }
        [0x80, 2..=5, ..] => "a bare pickle without tensors",
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => "a single NumPy array (save it as .npz)",
        [0x89, b'H', b'D', b'F', ..] => "an HDF5 file",
        [0x1f, 0x8b, ..] => "a gzip file (unpack it first)",
        [0x28, 0xb5, 0x2f, 0xfd, ..] => "a zstd file (unpack it first)",
        [b'g', b'l', b'T', b'F', ..] => "a glTF binary",
        [0x89, b'P', b'N', b'G', ..] => "a PNG picture",
        _ => return None,
    })
}
