//! Files that are being read. No output may replace one of them, under any name.

use crate::base::lock::lock;
use std::path::Path;
use std::sync::{Arc, Mutex, Weak};

use same_file::Handle;

/// The guarded files of this process.
static GUARDED: Mutex<Vec<Weak<Handle>>> = Mutex::new(Vec::new());

/// Keeps a file from being replaced by an [`Output`](super::Output) of this process for as long as
/// the guard lives.
#[derive(Debug)]
pub struct Guard(#[expect(dead_code, reason = "it is held, not read")] Arc<Handle>);

impl Guard {
    /// Guards the file at a path. `None` if it cannot be opened, so that nothing reads it either.
    pub fn of(path: &Path) -> Option<Self> {
        let handle = Arc::new(handle(path)?);
        let mut guarded = lock(&GUARDED);
        guarded.retain(|file| file.strong_count() > 0);
        guarded.push(Arc::downgrade(&handle));
        Some(Self(handle))
    }
}

/// True if the path names a guarded file, also via links or another spelling.
pub fn is_guarded(path: &Path) -> bool {
    let Some(handle) = handle(path) else { return false };
    let guarded = lock(&GUARDED);
    guarded.iter().filter_map(Weak::upgrade).any(|file| *file == handle)
}

/// A regular file's identity. Pipes and devices are not opened, because that may block forever.
fn handle(path: &Path) -> Option<Handle> {
    path.metadata().ok().filter(std::fs::Metadata::is_file)?;
    Handle::from_path(path).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_guarded_under_every_name_while_its_guard_lives() {
        let folder = tempfile::tempdir().expect("a folder");
        let [file, link, other] = ["a", "b", "c"].map(|name| folder.path().join(name));
        std::fs::write(&file, "x").expect("written");
        std::fs::write(&other, "x").expect("written");
        std::fs::hard_link(&file, &link).expect("linked");
        let guard = Guard::of(&file).expect("a file");
        let dotted = folder.path().join(".").join("a");
        assert!(is_guarded(&file) && is_guarded(&link) && is_guarded(&dotted));
        assert!(!is_guarded(&other) && !is_guarded(folder.path()));
        drop(guard);
        assert!(!is_guarded(&file));
    }
}
