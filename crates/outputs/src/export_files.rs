//! The files of an export, which get their names together or not at all.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::base::bytes::{ByteSink, LinkedFolder, Output, SourceFile, hex, remove_stale, sha256};
use crate::base::error::{Error, Result};

/// Files that are being written.
#[derive(Debug)]
pub struct ExportFiles {
    output: PathBuf,
    overwrite: bool,
    files: Vec<(PathBuf, Output)>,
}

/// A file of a finished export.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct FileReport {
    /// Path of the file.
    pub path: String,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// SHA-256 of the file in hexadecimal.
    pub sha256: String,
}

impl ExportFiles {
    /// Of an export to `output`. Existing files are refused unless `overwrite`.
    pub fn new(output: &Path, overwrite: bool) -> Self {
        Self { output: output.to_owned(), overwrite, files: Vec::new() }
    }

    /// The path that the user has named.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// Starts writing a file.
    ///
    /// # Errors
    ///
    /// As [`Output::create`].
    pub fn create(&mut self, path: PathBuf) -> Result<&mut Output> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        remove_stale(folder.unwrap_or(Path::new(".")));
        let output = Output::create(&path, self.overwrite)?;
        self.files.push((path, output));
        let last = self.files.len() - 1;
        Ok(&mut self.files[last].1)
    }

    /// Writes a whole file.
    ///
    /// # Errors
    ///
    /// As [`Output::create`], and those of writing.
    pub fn add(&mut self, path: PathBuf, bytes: &[u8]) -> Result<()> {
        self.create(path)?.append(bytes)
    }

    /// The written bytes, for reading back.
    pub fn written(&self) -> WrittenFiles {
        let written =
            |(path, output): &(PathBuf, Output)| (path.clone(), output.written().to_owned());
        WrittenFiles { files: self.files.iter().map(written).collect() }
    }

    /// Gives all files their names.
    ///
    /// # Errors
    ///
    /// As [`Output::finish_all`].
    pub fn finish(self) -> Result<()> {
        Output::finish_all(self.files.into_iter().map(|(_, output)| output).collect())
    }
}

/// Files that are whole but have no names yet: the path that each will have, and where it is.
#[derive(Debug)]
pub struct WrittenFiles {
    files: Vec<(PathBuf, PathBuf)>,
}

impl WrittenFiles {
    /// The files of a finished export, under their names.
    pub fn of_paths(paths: impl IntoIterator<Item = PathBuf>) -> Self {
        Self { files: paths.into_iter().map(|path| (path.clone(), path)).collect() }
    }

    /// The path of the first file.
    pub fn first(&self) -> &Path {
        self.files.first().map_or(Path::new(""), |(path, _)| path)
    }

    /// The only file whose name has an extension.
    ///
    /// # Errors
    ///
    /// None, or that of opening it.
    pub fn with_extension(&self, extension: &str) -> Result<Arc<SourceFile>> {
        let has = |path: &Path| path.extension().is_some_and(|own| own == extension);
        let found = self.files.iter().find(|(path, _)| has(path));
        let (_, place) = found.ok_or_else(|| {
            Error::usage(format!("the name of the output must end in .{extension}"))
        })?;
        SourceFile::open(place).map(Arc::new)
    }

    /// The bytes of the file that has, or will have, this name in its folder.
    pub fn named(&self, name: &str) -> Option<&Path> {
        let found = self.files.iter().find(|(path, _)| path.file_name().is_some_and(|n| n == name));
        found.map(|(_, place)| place.as_path())
    }

    /// A folder of links to the files, under their future names. It is removed on drop.
    ///
    /// # Errors
    ///
    /// Those of the operating system.
    pub fn linked(&self) -> Result<LinkedFolder> {
        let beside = self.files.first().and_then(|(_, place)| place.parent());
        let mut folder = LinkedFolder::new(beside.unwrap_or(Path::new(".")))?;
        for (path, place) in &self.files {
            folder.add(place, path.file_name().unwrap_or_default())?;
        }
        Ok(folder)
    }

    /// Lengths and digests.
    ///
    /// # Errors
    ///
    /// Those of reading.
    pub fn report(&self) -> Result<Vec<FileReport>> {
        let report = |(path, place): &(PathBuf, PathBuf)| {
            let file = SourceFile::open(place)?;
            let sha256 = hex(&sha256(&file)?);
            let path = path.to_string_lossy().into_owned();
            Ok(FileReport { path, bytes: file.length(), sha256 })
        };
        self.files.iter().map(report).collect()
    }
}
