//! The supported file syntaxes, one row each. A new syntax needs a reader, a [`FileKind`] and a
//! row, which defines detection, the expected files in messages, and the extensions of verbs.
//!
//! [`FileKind`]: super::FileKind

use std::sync::Arc;

use super::file::TensorFile;
use super::zip::Archive;
use super::{msgpack, npz, nvdb, parameters, ply, safetensors, torch, vdb};
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::file_kind::{VDB_MAGIC, is_safetensors, is_zip};
use crate::base::limits::Limits;

/// A syntax of files.
pub(super) struct Syntax {
    /// The name of its files in messages.
    pub name: &'static str,
    /// The usual ends of their names.
    pub extensions: &'static [&'static str],
    /// True for one of its files; the second argument is the file's start.
    pub is: fn(&SourceFile, &[u8]) -> Result<bool>,
    /// Opens one.
    pub open: fn(&Arc<SourceFile>, &Limits) -> Result<TensorFile>,
}

/// All syntaxes, in the order of detection.
pub(super) const SYNTAXES: [Syntax; 7] = [
    Syntax {
        name: "a PyTorch checkpoint or an .npz file (both zip)",
        extensions: &["ckpt", "npz", "pt", "pth", "tar", "th"],
        is: |_, start| Ok(is_zip(start)),
        open: |file, limits| {
            let archive = Arc::new(Archive::open(file, limits)?);
            match torch::find_pickle(&archive)? {
                Some(root) => torch::open(file, &archive, &root, limits),
                None => npz::open(file, &archive, limits),
            }
        },
    },
    Syntax {
        name: "a .safetensors file",
        extensions: &["safetensors"],
        is: |_, start| Ok(is_safetensors(start)),
        open: safetensors::open,
    },
    Syntax {
        name: "a folder of SNeRG or MERF",
        extensions: &["json"],
        is: |file, _| parameters::is_parameters(file),
        open: parameters::open,
    },
    Syntax {
        name: "an OpenVDB file",
        extensions: &["vdb"],
        is: |_, start| Ok(start.starts_with(&VDB_MAGIC)),
        open: vdb::open,
    },
    Syntax {
        name: "a NanoVDB file",
        extensions: &["nvdb"],
        is: |_, start| Ok(nvdb::is_nanovdb(start)),
        open: nvdb::open,
    },
    Syntax {
        name: "an Instant-NGP snapshot",
        extensions: &["ingp", "msgpack"],
        is: |_, start| Ok(msgpack::packing(start).is_some()),
        open: msgpack::open,
    },
    Syntax {
        name: "a PLY file of voxels",
        extensions: &["ply"],
        is: |file, _| ply::is_voxels(file),
        open: ply::open,
    },
];

/// The usual ends of the names of supported files.
pub fn extensions() -> impl Iterator<Item = &'static str> {
    SYNTAXES.iter().flat_map(|syntax| syntax.extensions).copied()
}

/// The syntax of a file, if it is one of them.
pub(super) fn syntax_of(file: &SourceFile, start: &[u8]) -> Result<Option<&'static Syntax>> {
    for syntax in &SYNTAXES {
        if (syntax.is)(file, start)? {
            return Ok(Some(syntax));
        }
    }
    Ok(None)
}

/// The list of expected files, for messages.
pub fn expected() -> String {
    let [others @ .., last] = &SYNTAXES.each_ref().map(|syntax| syntax.name);
    format!("{}, or {last}", others.join(", "))
}
