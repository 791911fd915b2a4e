//! Opens a file of tensors of any kind.

use std::path::Path;
use std::sync::Arc;

use super::file::TensorFile;
use super::kind::describe;
use super::ply::is_splats;
use super::syntaxes::{expected, syntax_of};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::file_kind::{no_download, old_checkpoint, start};
use crate::base::limits::Limits;

/// Opens a file of tensors, whatever its name.
///
/// # Errors `Io` if it cannot be read or is a folder, `Unsupported` for files of another kind
/// and for features that only a newer reader would know, `Malformed`, `Truncated`, `Checksum` for
/// damaged ones, `OverLimit` for files that exceed limits.
pub fn open(path: &Path, limits: &Limits) -> Result<TensorFile> {
    let file = Arc::new(SourceFile::open(path)?);
    open_file(&file, limits)
}

/// The same for a file that is given as bytes.
///
/// # Errors
/// Those of [`open()`].
pub fn open_file(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    open_kind(file, limits).map_err(|error| error.in_file(file.path()))
}

fn open_kind(file: &Arc<SourceFile>, limits: &Limits) -> Result<TensorFile> {
    let start = start(file)?;
    if let Some(syntax) = syntax_of(file, &start)? {
        return (syntax.open)(file, limits);
    }
    let expected = expected();
    if is_splats(file)? {
        let error = Error::unsupported(Place::File, "Gaussian splats (a PLY file)", expected);
        return Err(error.advise("splats have no density to bake: name the file of a field"));
    }
    Err(match old_checkpoint(&start) {
        Some(found) => Error::unsupported(Place::File, found, expected)
            .advise("save the model again with torch.save, as a dictionary of tensors"),
        None => match no_download(&start) {
            Some([found, remedy]) => {
                Error::unsupported(Place::File, found, expected).advise(remedy)
            }
            None => Error::wrong_kind(describe(file)?, expected),
        },
    })
}
