//! Files and folders that must not outlive a run that ends early.
//!
//! Their owners remove them on drop. A program that is ended by a signal drops nothing, so it
//! removes all of them by name.

use crate::base::lock::{Locked, lock};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock};

/// Locked permanently at the end of the program.
static ENDS: RwLock<()> = RwLock::new(());

fn noted() -> Locked<'static, BTreeSet<PathBuf>> {
    static NOTED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    lock(&NOTED)
}

/// Registers a file or folder as unfinished while this lives.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Registers its name.
    pub fn note(path: &Path) -> Self {
        // A relative name would change with the working folder.
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        noted().insert(path.clone());
        Self(path)
    }

    /// Removes the file, or the folder if it is empty.
    pub fn remove(&self) {
        remove(&self.0);
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        noted().remove(&self.0);
    }
}

/// Makes something and registers it, without an end of the program in between. The work must be
/// short and must not nest.
pub fn made_and_noted<T>(work: impl FnOnce() -> T) -> T {
    let _goes_on = ENDS.read().unwrap_or_else(PoisonError::into_inner);
    work()
}

/// Removes all unfinished files and folders of this process at its end. From then on, threads that
/// would make more block until the end.
pub fn remove_all() {
    std::mem::forget(ENDS.write().unwrap_or_else(PoisonError::into_inner));
    // Names inside a folder sort after the folder.
    noted().iter().rev().for_each(|path| remove(path));
}

fn remove(path: &Path) {
    if std::fs::remove_file(path).is_err() {
        std::fs::remove_dir(path).ok();
    }
}
