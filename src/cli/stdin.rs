//! The standard input as an input file.
//!
//! Inputs are read by position, which pipes do not support. So the program copies the standard
//! input to a temporary file first.

use std::io::{IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tempfile::NamedTempFile;

use super::output::STANDARD_STREAM;
use crate::base::bytes::{SourceFile, Unfinished};
use crate::base::error::{Error, Result};
use crate::base::lock::lock;
use crate::container::is_container;
use mipvog_inputs::{self, tensor};
use mipvog_outputs::gltf::asset::is_asset;

/// The name of the standard input in messages.
const STANDARD_INPUT: &str = "standard input";

/// A longer input must be of a supported kind, because an endless one would fill the disk.
const OF_ANY_KIND: u64 = 64 << 20;

static SPOOLED: Mutex<Option<Copy>> = Mutex::new(None);

/// The copy. It is also removed if a signal ends the program.
struct Copy {
    file: NamedTempFile,
    _unfinished: Unfinished,
}

/// The file to read for an input of the command line: for `-` the copy of the standard input, for a
/// folder of assets the file that describes it.
///
/// # Errors
///
/// The standard input is a terminal, or the copy cannot be written.
pub fn resolve(path: &Path) -> Result<PathBuf> {
    if path != Path::new(STANDARD_STREAM) {
        return Ok(mipvog_inputs::file_of(path));
    }
    let mut spooled = lock(&SPOOLED);
    let copy = match spooled.take() {
        Some(copy) => copy,
        None => spool()?,
    };
    let path = copy.file.path().to_owned();
    *spooled = Some(copy);
    Ok(path)
}

/// Removes the copy, because static values are not dropped at the end of the program.
pub fn remove_copy() {
    drop(lock(&SPOOLED).take());
}

/// A message with the copy's name replaced by that of the standard input.
pub fn named(message: &str) -> String {
    let spooled = lock(&SPOOLED);
    let path = spooled.as_ref().map(|copy| copy.file.path().display().to_string());
    path.map_or_else(|| message.to_owned(), |path| message.replace(&path, STANDARD_INPUT))
}

fn spool() -> Result<Copy> {
    let io = |error| Error::io(error, Path::new(STANDARD_INPUT));
    let mut stdin = std::io::stdin().lock();
    if stdin.is_terminal() {
        let message = "- reads the input from the standard input, which is a terminal here";
        return Err(Error::usage(message));
    }
    let mut file = tempfile::Builder::new().prefix("standard-input-").tempfile().map_err(io)?;
    let unfinished = Unfinished::note(file.path());
    let copied = std::io::copy(&mut (&mut stdin).take(OF_ANY_KIND), &mut file).map_err(io)?;
    if copied == OF_ANY_KIND {
        let start = SourceFile::open(file.path())?;
        if !(is_container(&start) || is_asset(&start) || tensor::is_tensors(&start)?) {
            let found = tensor::describe(&start)?;
            let expected = "a file of a kind that the program reads";
            return Err(Error::wrong_kind(found, expected).in_file(Path::new(STANDARD_INPUT)));
        }
    }
    std::io::copy(&mut stdin, &mut file).and_then(|_| file.flush()).map_err(io)?;
    Ok(Copy { file, _unfinished: unfinished })
}
