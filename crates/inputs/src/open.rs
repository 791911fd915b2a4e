//! The front door: a trained model from its file.

use std::path::{Path, PathBuf};

use super::families::open_tensors;
use super::options::SourceOptions;
use super::source::Source;
use super::tensor;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::nerfstudio::newest_checkpoint;
use crate::snerg::layout;

/// Opens a trained model, whose type is detected from the content. Grids stay in the file until
/// they are needed.
///
/// ```no_run
/// use mipvog::{BakeOptions, Baker};
///
/// let source = mipvog_inputs::open("fine_last.tar")?;
/// let report = Baker::new(BakeOptions::default()).to_file(&source, "scene.mipvog", false)?;
/// println!("{} bytes", report.output_bytes);
/// # Ok::<(), mipvog::Error>(())
/// ```
///
/// # Errors
///
/// A file that cannot be read, is malformed, exceeds the default [`Limits`], or holds an
/// unsupported model.
pub fn open(path: impl AsRef<Path>) -> Result<Source> {
    open_with(path.as_ref(), &SourceOptions::default(), &Limits::default())
}

/// The file to read for an input: for a folder of assets, the file that describes it; for the
/// folder of a nerfstudio run, its newest checkpoint.
pub fn file_of(path: &Path) -> PathBuf {
    let described = path.join(layout::PARAMETERS);
    if described.is_file() {
        return described;
    }
    newest_checkpoint(path).unwrap_or_else(|| path.to_owned())
}

/// Opens a trained model, with settings that its file lacks.
///
/// # Errors
///
/// As [`open()`], and settings that are out of range.
pub fn open_with(path: &Path, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    open_tensors(&tensor::open(&file_of(path), limits)?, options, limits)
}
