//! Files and folders that must not outlive a run that ends early.
//!
//! Their owners remove them when they are dropped. A program that is ended from outside, by a
//! signal, drops nothing: it removes all of them by their names.

use crate::base::lock::{Locked, lock};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock};

/// Locked for good by the end of the program.
static ENDS: RwLock<()> = RwLock::new(());

fn noted() -> Locked<'static, BTreeSet<PathBuf>> {
    static NOTED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    lock(&NOTED)
}

/// A file or folder that is unfinished as long as this lives.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Notes its name.
    pub fn note(path: &Path) -> Self {
        // Another working folder would make another file of a relative name.
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

/// Makes something and notes it, with no end of the program in between. The work is short and makes
/// nothing else this way.
pub fn made_and_noted<T>(work: impl FnOnce() -> T) -> T {
    let _goes_on = ENDS.read().unwrap_or_else(PoisonError::into_inner);
    work()
}

/// Removes everything that is unfinished in this process, for its end. From then on nothing is made
/// any more: threads that would make something wait for the end.
pub fn remove_all() {
    std::mem::forget(ENDS.write().unwrap_or_else(PoisonError::into_inner));
    // Names inside a folder sort behind its own.
    noted().iter().rev().for_each(|path| remove(path));
}

fn remove(path: &Path) {
    if std::fs::remove_file(path).is_err() {
        std::fs::remove_dir(path).ok();
    }
}
