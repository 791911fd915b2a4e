//! A folder of links to unnamed files.

use std::ffi::OsStr;
use std::path::Path;

use tempfile::TempDir;

use super::stale;
use super::unfinished::{Unfinished, made_and_noted};
use crate::base::error::{Error, Result};

/// A folder of links under the expected names. It is removed on drop, and when the program is ended
/// from outside.
#[derive(Debug)]
pub struct LinkedFolder {
    // Dropped in this order: names stay registered until the folder is removed.
    folder: TempDir,
    unfinished: Vec<Unfinished>,
}

impl LinkedFolder {
    /// An empty one in the folder `beside`.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn new(beside: &Path) -> Result<Self> {
        let made = made_and_noted(|| {
            let folder = tempfile::Builder::new().prefix(stale::PREFIX).tempdir_in(beside)?;
            let unfinished = vec![Unfinished::note(folder.path())];
            Ok(Self { folder, unfinished })
        });
        made.map_err(|error| Error::io(error, beside))
    }

    /// Adds the file at `place` under a name.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn add(&mut self, place: &Path, name: &OsStr) -> Result<()> {
        let link = self.path().join(name);
        self.unfinished.push(Unfinished::note(&link));
        // Some file systems have no links.
        let made = made_and_noted(|| {
            std::fs::hard_link(place, &link).or_else(|_| std::fs::copy(place, &link).map(drop))
        });
        made.map_err(|error| Error::io(error, &link))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_under_their_names_and_go_with_the_folder() {
        let root = tempfile::tempdir().expect("a folder");
        let file = root.path().join("a.partial");
        std::fs::write(&file, b"bytes").expect("writable");
        let mut linked = LinkedFolder::new(root.path()).expect("a folder");
        linked.add(&file, OsStr::new("a.png")).expect("a link");
        let path = linked.path().to_owned();
        assert_eq!(std::fs::read(path.join("a.png")).expect("there"), b"bytes");
        assert!(linked.add(&root.path().join("none"), OsStr::new("b")).is_err());
        drop(linked);
        assert!(!path.exists() && file.exists());
    }
}
