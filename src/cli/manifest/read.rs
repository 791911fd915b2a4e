//! Reads files of JSON lines, one line at a time.

use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

use super::super::failure::message;
use super::super::output::{address_reason, check_container_name, no_file_reason};
use super::line::SceneLine;
use super::options::OptionKind;
use super::words::{Words, Written};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::text::without_mark;
use mipvog_inputs::tensor::describe;

/// Bytes of a line, at most.
const LONGEST_LINE: u64 = 1 << 20;

/// A file of lines. Empty lines are skipped.
#[derive(Debug)]
pub struct Lines {
    path: PathBuf,
    reader: BufReader<File>,
    number: u64,
}

impl Lines {
    /// Opens a file.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| Error::io(error, path))?;
        Ok(Self { path: path.to_owned(), reader: BufReader::new(file), number: 0 })
    }

    /// The error for a file that does not start with text.
    fn other_kind(&self) -> Error {
        let found = SourceFile::open(&self.path).and_then(|file| describe(&file));
        let found = found.unwrap_or("no UTF-8");
        let expected = "lines of JSON: a manifest, or the results of one";
        Error::wrong_kind(found, expected).in_file(&self.path)
    }

    /// The next line and its number, counted from 1.
    ///
    /// # Errors
    /// Errors of the operating system; `Malformed` for a line that is not UTF-8 or longer than
    /// [`LONGEST_LINE`].
    pub fn next_line(&mut self) -> Result<Option<(u64, String)>> {
        loop {
            let mut line = Vec::new();
            let mut reader = (&mut self.reader).take(LONGEST_LINE + 1);
            let read = reader.read_until(b'\n', &mut line);
            if read.map_err(|error| Error::io(error, &self.path))? == 0 {
                return Ok(None);
            }
            self.number += 1;
            let wrong = |found: &str, expected: &str| {
                Error::malformed(Place::Line(self.number), found, expected).in_file(&self.path)
            };
            if line.len() as u64 > LONGEST_LINE {
                return Err(wrong("more than 1048576 bytes", "a JSON object a line"));
            }
            let line = if self.number == 1 { without_mark(&line).to_vec() } else { line };
            let line = String::from_utf8(line).map_err(|_| match self.number {
                1 => self.other_kind(),
                _ => wrong("no UTF-8", "UTF-8"),
            })?;
            let line = line.trim();
            if !line.is_empty() {
                return Ok(Some((self.number, line.to_owned())));
            }
        }
    }
}

/// A manifest with checked lines.
#[derive(Debug)]
pub struct Manifest<'a> {
    lines: Lines,
    known: &'a [OptionKind],
    /// Its scenes.
    pub scenes: u64,
}

/// Refuses invalid values in a scene's command line.
pub type CheckScene<'a> = &'a dyn Fn(Vec<OsString>) -> Result<()>;

/// The canonical name of an existing or future file, with links resolved.
fn place(base: &Path, path: &Path) -> Result<PathBuf> {
    let joined = base.join(path);
    let absolute = std::path::absolute(&joined).map_err(|error| Error::io(error, &joined))?;
    let mut place = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => drop(place.pop()),
            part => place.push(part),
        }
    }
    Ok(place)
}

/// The files that lines read and write. None is written twice, or read and written.
#[derive(Debug, Default)]
struct Files {
    /// Written files, and their writers.
    written: HashMap<PathBuf, String>,
    /// Read files, and their lines.
    read: HashMap<PathBuf, u64>,
}

impl Files {
    /// The conflict of a file that `by` writes, if any.
    fn write(&mut self, place: PathBuf, by: String) -> Option<String> {
        if let Some(line) = self.read.get(&place) {
            return Some(format!("which line {line} reads"));
        }
        self.written.insert(place, by).map(|former| format!("which {former} writes too"))
    }

    /// The conflict of a file that a line reads, if any.
    fn read(&mut self, place: PathBuf, line: u64) -> Option<String> {
        let writer = self.written.get(&place).map(|by| format!("which {by} writes"));
        self.read.insert(place, line);
        writer
    }
}

/// True if a path stays within the folder that it is joined to.
fn is_below(path: &Path) -> bool {
    let mut parts = path.components();
    parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

impl<'a> Manifest<'a> {
    /// Reads every line once. If `words` has a folder of outputs, all outputs must stay within it.
    /// `results` is the file of results, if there is one.
    ///
    /// # Errors
    /// Errors of the operating system; `Malformed` with the line that breaks the form, or that
    /// writes a file that another line or the results have or one outside the folder, and for a
    /// file without lines; `Usage` for an output that is an address, and for options that `check`
    /// refuses.
    pub fn open(
        path: &Path,
        words: &Words<'a>,
        results: Option<&Path>,
        check: CheckScene,
    ) -> Result<Self> {
        let mut manifest = Self { lines: Lines::open(path)?, known: words.known, scenes: 0 };
        let folder = path.parent().unwrap_or(Path::new(""));
        let has_folder = !words.outputs.as_os_str().is_empty();
        let own = if has_folder { words.outputs } else { folder };
        let (mut files, mut checked) = (Files::default(), HashSet::new());
        if let Some(results) = results {
            files.written.insert(place(Path::new(""), results)?, "--results".to_owned());
        }
        while let Some((number, line)) = manifest.next_scene()? {
            let wrong = |found: String, expected: &str| {
                Error::malformed(Place::Line(number), found, expected).in_file(path)
            };
            for file in words.written(&line) {
                let Written { option, path: named, is_own } = &file;
                let shown = format!("{option} {}", named.display());
                if let Some(reason) = address_reason(named) {
                    let message = format!("line {number}: {shown}: {reason}");
                    return Err(Error::usage(message).in_file(path));
                }
                if *is_own && has_folder && !is_below(named) {
                    let expected = "a path below the folder of --output, without ..";
                    return Err(wrong(shown, expected));
                }
                let place = place(if *is_own { own } else { folder }, named)?;
                if let Some(reason) = files.write(place, format!("line {number}")) {
                    return Err(wrong(format!("{shown}, {reason}"), "a file of its own"));
                }
            }
            let output = Path::new(&line.output);
            if let Some(reason) = no_file_reason(output) {
                return Err(wrong(format!("output {}, {reason}", line.output), "a file"));
            }
            check_container_name(output).map_err(|error| {
                Error::usage(format!("line {number}: {}", error.kind())).in_file(path)
            })?;
            let input = Path::new(&line.input);
            if address_reason(input).is_none()
                && let Some(reason) = files.read(place(folder, input)?, number)
            {
                let found = format!("input {}, {reason}", line.input);
                return Err(wrong(found, "an input that nothing of this run writes"));
            }
            // Lines of a catalogue mostly have the same options.
            if checked.insert(serde_json::Value::from(line.options.clone()).to_string()) {
                check(words.of(&line)).map_err(|error| {
                    let message = format!("line {number}: {}", message(&error));
                    Error::usage(message).in_file(path)
                })?;
            }
            manifest.scenes += 1;
        }
        if manifest.scenes == 0 {
            let error = Error::malformed(Place::File, "no line", "a JSON object a scene");
            return Err(error.in_file(path));
        }
        let lines = &mut manifest.lines;
        lines.reader.seek(SeekFrom::Start(0)).map_err(|error| Error::io(error, path))?;
        lines.number = 0;
        Ok(manifest)
    }

    /// The next scene, with the number of its line, counted from 1.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn next_scene(&mut self) -> Result<Option<(u64, SceneLine)>> {
        let Some((number, text)) = self.lines.next_line()? else { return Ok(None) };
        let scene = SceneLine::parse(&text, number, self.known);
        Ok(Some((number, scene.map_err(|error| error.in_file(&self.lines.path))?)))
    }
}
