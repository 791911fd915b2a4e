//! A container's levels as a file of dense arrays.

use mipvog::unpacked::{append_all, check_levels, header, rows, texts};

use super::npz::NpzSink;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::container::Container;

/// The kind of file that tensors are written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TensorFormat {
    /// One header, then all values.
    Safetensors,
    /// A NumPy archive: a zip file of arrays.
    Npz,
}

/// Writes the levels in `levels` (all if empty) to `output`, complete but not yet finished.
///
/// # Errors
///
/// `InvalidOption` for missing levels; damage; errors of writing.
pub fn write_tensors(
    container: &Container,
    levels: &[usize],
    format: TensorFormat,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<()> {
    check_levels(container, levels)?;
    let head = container.read_head()?;
    let metadata = container.metadata();
    let rows = rows(metadata, levels, head.0.as_ref(), head.1.as_ref())?;
    match format {
        TensorFormat::Safetensors => {
            let text = header(container, metadata, &rows)?;
            output.append(&(text.len() as u64).to_le_bytes())?;
            output.append(text.as_bytes())?;
            append_all(container, head, levels, output, progress)
        }
        TensorFormat::Npz => {
            let texts = texts(container, metadata)?;
            let texts = texts.iter().map(|(name, text)| (*name, text.as_str()));
            let mut archive = NpzSink::new(output, texts, rows)?;
            append_all(container, head, levels, &mut archive, progress)?;
            archive.finish()
        }
    }
}
