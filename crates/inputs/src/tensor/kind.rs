//! Detects the kind of a file from its first bytes.

use super::msgpack::packing;
use super::syntaxes::syntax_of;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::file_kind::{self, UNKNOWN, start};

/// True if a file starts like one of tensors.
///
/// # Errors
/// If its start cannot be read.
pub fn is_tensors(file: &SourceFile) -> Result<bool> {
    Ok(syntax_of(file, &start(file)?)?.is_some())
}

/// Names the kind of a file, if its start reveals it.
///
/// # Errors
/// If its start cannot be read.
pub fn describe(file: &SourceFile) -> Result<&'static str> {
    let known = file_kind::describe(file)?;
    let is_packed = known == UNKNOWN && packing(&start(file)?).is_some();
    Ok(if is_packed { "a MessagePack document" } else { known })
}
