//! Temporary files of runs that were killed.
//!
//! Every output is locked while it is being written. The system releases the lock with the process,
//! however it ends. So an unlocked file with the name of such an output has no owner, and the next
//! run that writes to the folder removes it. On file systems without locks, nothing is removed.

use crate::base::lock::lock;
use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tempfile::NamedTempFile;

/// First part of temporary files' names.
pub const PREFIX: &str = ".mipvog-";
/// Last part of temporary files' names.
pub const SUFFIX: &str = ".partial";

/// Removes leftover files of killed runs from a folder, once per folder and process, because
/// folders of pictures are large.
pub fn remove(folder: &Path) {
    static CLEANED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let mut cleaned = lock(&CLEANED);
    let Ok(folder) = folder.canonicalize() else { return };
    if !cleaned.insert(folder.clone()) {
        return;
    }
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && name.starts_with(PREFIX) && name.ends_with(SUFFIX) {
            remove_unlocked(&entry.path());
        }
    }
}

/// Removes a file unless another process has it locked.
fn remove_unlocked(path: &Path) {
    let Ok(file) = File::options().read(true).write(true).open(path) else { return };
    if file.try_lock().is_ok() {
        // The lock is held until the name is removed, so that no other process takes the file in
        // between.
        std::fs::remove_file(path).ok();
    }
}

/// Locks a new temporary file. `false` if another process removed it before.
pub fn claim(temporary: &NamedTempFile) -> bool {
    // Without locks, no process removes anything.
    temporary.as_file().lock().is_err() || temporary.path().exists()
}
