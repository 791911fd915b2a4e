//! Reads files of JSON lines, one line at a time.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

use super::line::SceneLine;
use super::options::OptionKind;
use crate::base::error::{Error, Place, Result};
use crate::base::text::without_mark;

/// Bytes of a line, at most.
const LONGEST_LINE: u64 = 1 << 20;

/// A file of lines. Empty lines are passed over.
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
    /// Those of the operating system.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| Error::io(error, path))?;
        Ok(Self { path: path.to_owned(), reader: BufReader::new(file), number: 0 })
    }

    /// The next line and its number, counted from 1.
    ///
    /// # Errors
    /// Those of the operating system; `Malformed` for a line that is no UTF-8 or beyond
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
            let line = String::from_utf8(line).map_err(|_| wrong("no UTF-8", "UTF-8"))?;
            let line = line.trim();
            if !line.is_empty() {
                return Ok(Some((self.number, line.to_owned())));
            }
        }
    }
}

/// A manifest whose lines were all held to their form.
#[derive(Debug)]
pub struct Manifest<'a> {
    lines: Lines,
    known: &'a [OptionKind],
    /// Its scenes.
    pub scenes: u64,
}

/// A path without steps that lead nowhere: `./a` and `a` are one file.
fn plain(path: &str) -> PathBuf {
    Path::new(path).components().filter(|part| *part != Component::CurDir).collect()
}

/// True if a path leads nowhere but into the folder that it is joined to.
fn is_below(path: &str) -> bool {
    let mut parts = Path::new(path).components();
    parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

impl<'a> Manifest<'a> {
    /// Reads every line once. With `has_folder` the outputs lie in a folder of the command line,
    /// and no line may lead out of it.
    ///
    /// # Errors
    /// Those of the operating system; `Malformed` with the line that breaks the form, that names an
    /// output of a former line or one outside the folder, or for a file without lines.
    pub fn open(path: &Path, known: &'a [OptionKind], has_folder: bool) -> Result<Self> {
        let mut manifest = Self { lines: Lines::open(path)?, known, scenes: 0 };
        let mut outputs: HashMap<PathBuf, u64> = HashMap::new();
        while let Some((number, line)) = manifest.next_scene()? {
            if has_folder && !is_below(&line.output) {
                let found = format!("output {}", line.output);
                let expected = "a path below the folder of --output";
                return Err(Error::malformed(Place::Line(number), found, expected).in_file(path));
            }
            if let Some(former) = outputs.insert(plain(&line.output), number) {
                let found = format!("output {} of line {former} again", line.output);
                let error = Error::malformed(Place::Line(number), found, "an output of its own");
                return Err(error.in_file(path));
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
