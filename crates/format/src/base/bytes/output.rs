//! Atomic outputs, which appear complete under their name or not at all.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::guard::is_guarded;
use super::unfinished::{Unfinished, made_and_noted};
use super::{ByteSink, pause, stale};
use crate::base::error::{Error, ErrorKind, Place, Result};

/// A file being written beside its final name; [`Output::finish`] renames it into place, and
/// dropping it before that removes it.
#[derive(Debug)]
pub struct Output {
    temporary: tempfile::NamedTempFile,
    path: PathBuf,
    destination: Destination,
    length: u64,
    /// Removes it unless renamed.
    _unfinished: Unfinished,
    /// Dropped after the temporary file in them.
    _folders: NewFolders,
}

/// The place of the finished bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Destination {
    /// A name that must be free.
    FreeName,
    /// A name whose file is replaced.
    AnyName,
    /// The standard output.
    Stdout,
}

/// Folders that were made for an output, removed with it if empty.
#[derive(Debug, Default)]
struct NewFolders(Vec<Unfinished>);

impl NewFolders {
    /// Makes a folder and its missing parents.
    fn make(folder: &Path) -> Result<Self> {
        let mut made = Self::default();
        make_folders(folder, &mut made.0)?;
        Ok(made)
    }
}

/// Makes a folder and its missing parents, and adds them to `made`, outermost first.
pub(super) fn make_folders(folder: &Path, made: &mut Vec<Unfinished>) -> Result<()> {
    // A trailing slash would hide a file in the folder's place.
    let folder = folder.components().as_path();
    let is_here = |path: &Path| path.as_os_str().is_empty();
    // A dangling link counts as existing.
    let missing = |path: &&Path| !is_here(path) && path.symlink_metadata().is_err();
    let missing: Vec<&Path> = folder.ancestors().take_while(missing).collect();
    let there = folder.ancestors().nth(missing.len());
    if let Some(file) = there.filter(|path| !is_here(path) && !path.is_dir()) {
        let message = "a file is in a folder's place";
        return Err(Error::io(std::io::Error::other(message), file));
    }
    // Registered first, because making the last of them may fail.
    made.extend(missing.into_iter().rev().map(Unfinished::note));
    made_and_noted(|| std::fs::create_dir_all(folder)).map_err(|error| Error::io(error, folder))
}

/// Refuses folders, devices, pipes, and links to them, which must not be replaced. Other links are
/// replaced, not followed.
fn refuse_unreplaceable(path: &Path) -> std::io::Result<()> {
    let Ok(found) = path.metadata() else { return Ok(()) };
    // Links to the program's own streams, which may be files at the moment.
    let is_stream = || path.parent() == Some(Path::new("/dev"));
    let (kind, name) = match found.is_dir() {
        true => (std::io::ErrorKind::IsADirectory, "a folder"),
        false if found.is_file() && !is_stream() => return Ok(()),
        false => (std::io::ErrorKind::InvalidInput, "a device or pipe"),
    };
    Err(std::io::Error::new(kind, format!("{name} is in the output's place")))
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        self.0.iter().rev().for_each(Unfinished::remove);
    }
}

impl Output {
    /// Starts writing `path`; missing folders are made. An existing file is refused unless
    /// `overwrite`, and a file that this process is reading is always refused.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Exists`], [`ErrorKind::IsInput`], and those of the operating system.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self> {
        refuse_unreplaceable(path).map_err(|error| Error::io(error, path))?;
        if is_guarded(path) {
            return Err(Error::new(ErrorKind::IsInput, Place::File).in_file(path));
        }
        if !overwrite && path.symlink_metadata().is_ok() {
            return Err(Error::new(ErrorKind::Exists, Place::File).in_file(path));
        }
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let folders = NewFolders::make(folder)?;
        let destination = if overwrite { Destination::AnyName } else { Destination::FreeName };
        Self::in_folder(folder, path, destination, folders)
    }

    /// Starts writing to the standard output. It gets the bytes only when they are complete, so
    /// that earlier bytes can be overwritten until then.
    ///
    /// # Errors
    ///
    /// The system's folder for temporary files cannot be written.
    pub fn stdout() -> Result<Self> {
        let folder = std::env::temp_dir();
        let stdout = Path::new("standard output");
        let output = Self::in_folder(&folder, stdout, Destination::Stdout, NewFolders::default());
        output.map_err(|error| Error::new(error.into_kind(), Place::File).in_file(&folder))
    }

    fn in_folder(
        folder: &Path,
        path: &Path,
        destination: Destination,
        folders: NewFolders,
    ) -> Result<Self> {
        // Without the temporary file's own name, which means nothing to users.
        let io = |error: std::io::Error| Error::io(error.kind().into(), path);
        let mut builder = tempfile::Builder::new();
        builder.prefix(stale::PREFIX).suffix(stale::SUFFIX);
        // The mode of a plain `File::create`; the umask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let make = || {
            let temporary = builder.tempfile_in(folder).map_err(io)?;
            let unfinished = Unfinished::note(temporary.path());
            Ok((temporary, unfinished))
        };
        let (mut temporary, mut unfinished) = made_and_noted(make)?;
        // Between its creation and its lock, another run may have removed it as stale.
        while !stale::claim(&temporary) {
            (temporary, unfinished) = made_and_noted(make)?;
        }
        pause::at("created");
        let path = path.to_owned();
        Ok(Self {
            temporary,
            path,
            destination,
            length: 0,
            _unfinished: unfinished,
            _folders: folders,
        })
    }

    /// Overwrites bytes near the start that were unknown before.
    pub fn patch(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        let mut file = self.file();
        let patched = file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(bytes))
            .and_then(|()| file.seek(SeekFrom::End(0)));
        patched.map(|_| ()).map_err(|error| Error::io(error, &self.path))
    }

    /// The file that holds the bytes until [`Output::finish`].
    pub fn written(&self) -> &Path {
        self.temporary.path()
    }

    /// Renames the file into place. Without `overwrite`, a file that appeared meanwhile stays.
    ///
    /// # Errors
    ///
    /// As [`Self::create`]. A closed standard output is not an error.
    pub fn finish(self) -> Result<()> {
        self.settle()?;
        self.rename()
    }

    /// Renames several files into place, all or none: signals are delayed until the last one is
    /// done, and if one fails, those before it are removed. A replaced file stays replaced.
    ///
    /// # Errors
    ///
    /// As [`Self::finish`].
    pub fn finish_all(outputs: Vec<Self>) -> Result<()> {
        outputs.iter().try_for_each(Self::settle)?;
        made_and_noted(|| {
            let mut made = Vec::new();
            for output in outputs {
                let path = output.path.clone();
                let is_new = path.symlink_metadata().is_err();
                if let Err(error) = output.rename() {
                    made.iter().for_each(|path| drop(std::fs::remove_file(path)));
                    return Err(error);
                }
                made.extend(is_new.then_some(path));
            }
            Ok(())
        })
    }

    /// Flushes the bytes to the disk, or to the standard output.
    fn settle(&self) -> Result<()> {
        let io = |error| Error::io(error, &self.path);
        if self.destination != Destination::Stdout {
            self.file().sync_data().map_err(io)?;
            pause::at("synced");
            return Ok(());
        }
        match copy_to_stdout(self.file()) {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            copied => copied.map_err(io),
        }
    }

    /// Renames the file on the disk into place.
    fn rename(self) -> Result<()> {
        let Self { temporary, path, destination, _folders, .. } = self;
        if destination == Destination::Stdout {
            return Ok(());
        }
        if is_guarded(&path) {
            return Err(Error::new(ErrorKind::IsInput, Place::File).in_file(&path));
        }
        let kept = match destination {
            Destination::AnyName => temporary.persist(&path),
            _ => temporary.persist_noclobber(&path),
        };
        kept.map_err(|failed| match failed.error.kind() {
            std::io::ErrorKind::AlreadyExists => {
                Error::new(ErrorKind::Exists, Place::File).in_file(&path)
            }
            _ => Error::io(failed.error, &path),
        })?;
        pause::at("renamed");
        Ok(())
    }

    fn file(&self) -> &File {
        self.temporary.as_file()
    }
}

impl ByteSink for Output {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file().write_all(bytes).map_err(|error| Error::io(error, &self.path))?;
        self.length += bytes.len() as u64;
        pause::at("appended");
        Ok(())
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn folder(&self) -> PathBuf {
        self.written().parent().unwrap_or(Path::new(".")).to_owned()
    }
}

fn copy_to_stdout(mut file: &File) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let mut stdout = std::io::stdout().lock();
    std::io::copy(&mut file, &mut stdout)?;
    stdout.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_of_a_run_get_their_names_together_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let paths = ["a", "b", "c"].map(|name| folder.path().join(name));
        let outputs = || paths.iter().map(|path| Output::create(path, false).expect("writable"));
        let refused: Vec<Output> = outputs().collect();
        // Another program creates a file of the second name.
        std::fs::write(&paths[1], b"other").expect("writable");
        let error = Output::finish_all(refused).expect_err("a name is taken");
        assert!(matches!(error.kind(), ErrorKind::Exists), "{error}");
        let names = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!((names, std::fs::read(&paths[1]).expect("there")), (1, b"other".to_vec()));
        std::fs::remove_file(&paths[1]).expect("there");
        Output::finish_all(outputs().collect()).expect("names are free");
        assert!(paths.iter().all(|path| path.is_file()));
    }
}
