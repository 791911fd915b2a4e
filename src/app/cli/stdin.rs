//! The standard input as an input file.
//!
//! Inputs are read by position, which a pipe cannot be. So the program copies it to a temporary
//! file first.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use super::output::STANDARD_STREAM;
use crate::base::error::{Error, Result};

static SPOOLED: Mutex<Option<NamedTempFile>> = Mutex::new(None);

/// The file to read for an input of the command line: for `-` the copy of the standard input.
///
/// # Errors
///
/// The standard input is a terminal, or the copy cannot be written.
pub fn resolve(path: &Path) -> Result<PathBuf> {
    if path != Path::new(STANDARD_STREAM) {
        return Ok(path.to_owned());
    }
    let mut spooled = SPOOLED.lock().unwrap_or_else(PoisonError::into_inner);
    let file = match spooled.take() {
        Some(file) => file,
        None => spool()?,
    };
    let path = file.path().to_owned();
    *spooled = Some(file);
    Ok(path)
}

/// Removes the copy. A value that lives as long as the program is not dropped at its end.
pub fn remove_copy() {
    drop(SPOOLED.lock().unwrap_or_else(PoisonError::into_inner).take());
}

fn spool() -> Result<NamedTempFile> {
    let io = |error| Error::io(error, Path::new("standard input"));
    let mut stdin = std::io::stdin().lock();
    if stdin.is_terminal() {
        let message = "- reads the input from the standard input, which is a terminal here";
        return Err(Error::usage(message));
    }
    let mut file = tempfile::Builder::new().prefix("standard-input-").tempfile().map_err(io)?;
    std::io::copy(&mut stdin, &mut file).and_then(|_| file.flush()).map_err(io)?;
    Ok(file)
}
