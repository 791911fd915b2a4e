//! The front door: a trained model from its file.

use std::path::Path;

use super::checkpoint::{self, Inspection, Source, SourceOptions};
use super::tensor::{self, TensorFile};
use crate::base::error::Result;
use crate::base::limits::Limits;

/// Opens a trained model, told by its content. Grids stay in the file until they are needed.
///
/// ```no_run
/// use mipvog_bake::{BakeOptions, Baker, open};
///
/// let source = open("fine_last.tar")?;
/// let report = Baker::new(BakeOptions::default()).to_file(&source, "scene.mipvog", false)?;
/// println!("{} bytes", report.output_bytes);
/// # Ok::<(), mipvog_bake::Error>(())
/// ```
///
/// # Errors
///
/// A file that cannot be read, is malformed, asks for more than the default
/// [`Limits`], or holds a model that this version does not know.
pub fn open(path: impl AsRef<Path>) -> Result<Source> {
    open_with(path.as_ref(), &SourceOptions::default(), &Limits::default())
}

/// Opens a trained model with settings that its file lacks.
///
/// # Errors
///
/// As [`open()`], and settings out of their range.
pub fn open_with(path: &Path, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    open_tensors(&tensor::open(path, limits)?, options, limits)
}

/// The same for a file whose tensors are known already. A new family of models is told here, by its
/// content.
///
/// # Errors
///
/// As [`open_with`].
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    checkpoint::open_tensors(file, options, limits)
}

/// The content of a file, without its grids' values.
///
/// # Errors
///
/// A file that cannot be read; a model that cannot be baked is stated in the report.
pub fn inspect(path: &Path, options: &SourceOptions, limits: &Limits) -> Result<Inspection> {
    checkpoint::inspect(path, options, limits)
}
