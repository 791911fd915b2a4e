//! Outputs that appear whole under their name, or not at all.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::unfinished::Unfinished;
use super::{ByteSink, stale};
use crate::base::error::{Error, ErrorKind, Place, Result};

/// A file being written beside its final name; [`Output::finish`] renames it into place, and
/// dropping it before that removes it.
#[derive(Debug)]
pub struct Output {
    temporary: tempfile::NamedTempFile,
    path: PathBuf,
    overwrite: bool,
    length: u64,
    /// Until it has its name.
    _unfinished: Unfinished,
}

impl Output {
    /// Starts writing `path`. An existing file there is refused unless `overwrite`.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self> {
        let io = |error| Error::io(error, path);
        // A link is replaced, not followed; devices, pipes and folders are not to be replaced.
        if let Ok(found) = path.symlink_metadata()
            && !found.is_file()
            && !found.is_symlink()
        {
            let kind = if found.is_dir() { "a folder" } else { "a device or pipe" };
            let message = format!("{kind} is in the output's place");
            return Err(io(std::io::Error::other(message)));
        }
        if !overwrite && path.symlink_metadata().is_ok() {
            return Err(Error::new(ErrorKind::Exists, Place::File).in_file(path));
        }
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(stale::PREFIX).suffix(stale::SUFFIX);
        // The mode that a plain `File::create` would ask for; the umask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut temporary = builder.tempfile_in(folder).map_err(io)?;
        // Between its creation and its lock another run may have taken it for stale.
        while !stale::claim(&temporary) {
            temporary = builder.tempfile_in(folder).map_err(io)?;
        }
        let unfinished = Unfinished::note(temporary.path());
        let path = path.to_owned();
        Ok(Self { temporary, path, overwrite, length: 0, _unfinished: unfinished })
    }

    /// Overwrites bytes near the start that could not be known before.
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

    /// Gives the file its name. Without `overwrite`, a file that appeared meanwhile stays.
    pub fn finish(self) -> Result<()> {
        let Self { temporary, path, overwrite, .. } = self;
        temporary.as_file().sync_data().map_err(|error| Error::io(error, &path))?;
        let kept =
            if overwrite { temporary.persist(&path) } else { temporary.persist_noclobber(&path) };
        kept.map(|_| ()).map_err(|failed| match failed.error.kind() {
            std::io::ErrorKind::AlreadyExists => {
                Error::new(ErrorKind::Exists, Place::File).in_file(&path)
            }
            _ => Error::io(failed.error, &path),
        })
    }

    fn file(&self) -> &File {
        self.temporary.as_file()
    }
}

impl ByteSink for Output {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file().write_all(bytes).map_err(|error| Error::io(error, &self.path))?;
        self.length += bytes.len() as u64;
        Ok(())
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn folder(&self) -> PathBuf {
        self.written().parent().unwrap_or(Path::new(".")).to_owned()
    }
}
