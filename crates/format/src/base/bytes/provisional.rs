//! Several outputs of a run that are kept together, or not at all.

use std::path::Path;

use super::output::make_folders;
use super::unfinished::{Unfinished, made_and_noted};
use super::{ByteSink, Output, stale};
use crate::base::error::Result;

/// The files and folders that a run has made so far. They are removed unless [`Self::keep`] is
/// called. Replaced files stay replaced.
#[derive(Debug, Default)]
pub struct Provisional {
    made: Vec<Unfinished>,
    bytes: u64,
}

impl Provisional {
    /// Makes a folder and its missing parents.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn create_folder(&mut self, folder: &Path) -> Result<()> {
        make_folders(folder, &mut self.made)?;
        stale::remove(folder);
        Ok(())
    }

    /// Writes a whole file. An existing one is refused unless `overwrite`.
    ///
    /// # Errors
    /// `Exists`, and those of the operating system.
    pub fn write(&mut self, path: &Path, bytes: &[u8], overwrite: bool) -> Result<()> {
        let mut output = Output::create(path, overwrite)?;
        output.append(bytes)?;
        let is_new = path.symlink_metadata().is_err();
        let noted = made_and_noted(|| {
            output.finish()?;
            Ok(is_new.then(|| Unfinished::note(path)))
        })?;
        self.bytes += bytes.len() as u64;
        self.made.extend(noted);
        Ok(())
    }

    /// Bytes of the files so far, replaced ones too.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Keeps everything.
    pub fn keep(mut self) {
        self.made.clear();
    }
}

impl Drop for Provisional {
    fn drop(&mut self) {
        // Files before the folders that they are in.
        self.made.iter().rev().for_each(Unfinished::remove);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_a_run_stay_together_or_go_together() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        std::fs::write(root.join("old"), b"old").expect("writable");
        let run = |keep: bool| {
            let mut made = Provisional::default();
            let inside = root.join("a/b");
            made.create_folder(&inside).expect("writable");
            made.write(&inside.join("new"), b"1", false).expect("writable");
            made.write(&root.join("old"), b"new", true).expect("writable");
            assert!(made.write(&root.join("old"), b"2", false).is_err());
            if keep {
                made.keep();
            }
        };
        run(false);
        assert!(!root.join("a").exists());
        assert_eq!(std::fs::read(root.join("old")).expect("there"), b"new");
        run(true);
        assert_eq!(std::fs::read(root.join("a/b/new")).expect("there"), b"1");
        for taken in ["old", "old/a/b"] {
            let refused = Provisional::default().create_folder(&root.join(taken));
            let message = refused.expect_err("a file").to_string();
            assert!(message.ends_with("old: a file is in a folder's place"), "{message}");
        }
        // A folder with other files stays.
        std::fs::remove_file(root.join("a/b/new")).expect("own");
        let mut made = Provisional::default();
        made.create_folder(&root.join("c")).expect("writable");
        std::fs::write(root.join("c/strange"), b"").expect("writable");
        drop(made);
        assert!(root.join("c/strange").exists());
    }
}
