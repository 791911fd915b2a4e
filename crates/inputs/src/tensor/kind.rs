//! Tells the kind of a file by its first bytes.

use super::msgpack::packing;
use super::nvdb::is_nanovdb;
use super::parameters::is_parameters;
use super::ply::MAGIC;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::file_kind::{self, UNKNOWN, VDB_MAGIC, is_safetensors, is_zip, start};

/// Bytes of the header of a PLY file, at most, that are looked through.
const LONGEST_PLY_HEADER: u64 = 1 << 13;

/// True if a file starts like one of tensors.
///
/// # Errors
/// If its start cannot be read.
pub fn is_tensors(file: &SourceFile) -> Result<bool> {
    let start = start(file)?;
    let known = is_zip(&start)
        || is_safetensors(&start)
        || packing(&start).is_some()
        || start.starts_with(&VDB_MAGIC)
        || is_nanovdb(&start);
    Ok(known || is_voxels(file)? || is_parameters(file)?)
}

/// Names the kind of a file, as far as its start tells.
///
/// # Errors
/// If its start cannot be read.
pub fn describe(file: &SourceFile) -> Result<&'static str> {
    let known = file_kind::describe(file)?;
    let is_packed = known == UNKNOWN && packing(&start(file)?).is_some();
    Ok(if is_packed { "a MessagePack document" } else { known })
}

/// True for a PLY file of Gaussian splats, whose header names their colours.
pub(super) fn is_splats(file: &SourceFile) -> Result<bool> {
    is_ply_of(file, ["f_dc_0", "rot_0"])
}

/// True for a PLY file of SVRaster's voxels.
pub(super) fn is_voxels(file: &SourceFile) -> Result<bool> {
    is_ply_of(file, ["octlevel", "grid0_value"])
}

/// True for a PLY file whose header has these words.
fn is_ply_of(file: &SourceFile, words: [&str; 2]) -> Result<bool> {
    let count = file.length().min(LONGEST_PLY_HEADER);
    let start = file.read(0, count, count)?;
    let names = |word: &str| start.windows(word.len()).any(|window| window == word.as_bytes());
    Ok(start.starts_with(MAGIC) && words.into_iter().all(names))
}
