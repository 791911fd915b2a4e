//! Writing pages.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Map, json};

use super::notes::notes;
use super::page::{data_of, linking, whole};
use super::site::{PAGE, SCRIPT, STYLE, WORKER};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::progress::{Progress, Step};
use crate::container::Container;
use crate::view::overview_png;
use crate::view::render::Renderer;
use mipvog_outputs::export_files::{ExportFiles, WrittenFiles};
use mipvog_outputs::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};

/// The page of a folder.
const INDEX: &str = "index.html";
/// The picture of a folder and its size, for link previews.
const POSTER: &str = "poster.png";
const POSTER_SIZE: [usize; 2] = [600, 315];
/// The text of a folder.
const NOTES: &str = "README.txt";

/// A page that shows a container.
#[derive(Debug)]
pub struct Html;

/// True for a page in one file, false for a folder.
fn is_file(output: &Path) -> bool {
    let ending = output.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| ["html", "htm"].contains(&&*ending.to_lowercase()))
}

/// The name of the container on its page.
fn container_name(source: &ExportSource) -> String {
    let stem = Path::new(&source.name).file_stem().unwrap_or_default().to_string_lossy();
    format!("{stem}.mipvog")
}

fn bytes_of(source: &ExportSource) -> Result<&[u8]> {
    let missing = || Error::usage("a page needs a container, but there is none");
    source.container.as_deref().ok_or_else(missing)
}

impl ExportFormat for Html {
    fn name(&self) -> &'static str {
        "html"
    }

    fn options(&self) -> &'static [&'static str] {
        &[]
    }

    fn takes_container(&self) -> bool {
        true
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        let expected = "0: a page has all levels";
        Error::require_option(options.level == 0, "level", options.level, expected)?;
        let bytes = bytes_of(source)?.len() as u64;
        // Bytes, their base64 text, and the page.
        let page = (PAGE.len() + SCRIPT.len() + STYLE.len() + WORKER.len()) as u64;
        let needed = if is_file(output) { 4 * bytes + 2 * page } else { bytes };
        limits::check(
            LimitName::Memory,
            "bytes of a page",
            needed,
            options.limits.memory,
            &Place::File,
        )
    }

    fn write(
        &self,
        source: &ExportSource,
        _: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let output = files.output().to_owned();
        let (name, bytes) = (container_name(source), bytes_of(source)?);
        let mut details = Map::new();
        details.insert("container".to_owned(), json!(name));
        details.insert("container_bytes".to_owned(), json!(bytes.len()));
        if is_file(&output) {
            progress.begin(Step::Write, 1);
            files.add(output, whole(&name, bytes).as_bytes())?;
        } else {
            let poster = overview_png(&source.field, POSTER_SIZE, progress)?;
            progress.begin(Step::Write, 1);
            let page = linking(&name, POSTER, POSTER_SIZE);
            let texts = [
                (INDEX, page.as_bytes()),
                ("viewer.js", SCRIPT.as_bytes()),
                ("worker.js", WORKER.as_bytes()),
                ("style.css", STYLE.as_bytes()),
                (POSTER, &poster),
                (NOTES, notes(&name).as_bytes()),
                (&name, bytes),
            ]
            .map(|(name, bytes)| (output.join(name), bytes.to_owned()));
            for (path, bytes) in texts {
                files.add(path, &bytes)?;
            }
        }
        progress.advance(Step::Write, 1);
        Ok(Exported { lost: Vec::new(), details })
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        let name = container_name(source);
        let container = match files.named(&name) {
            Some(path) => Container::open(Arc::new(SourceFile::open(path)?), limits)?,
            None => {
                let page = files.with_extension("html")?;
                let text = page.read(0, page.length(), limits.memory)?;
                let data = data_of(&String::from_utf8_lossy(&text)).ok_or_else(|| {
                    Error::malformed(Place::File, "a page without data", "a container in base64")
                })?;
                Container::from_bytes(data, limits)?
            }
        };
        let mut field = Renderer::of_container(&container)?;
        let (view, own) = (source.field.view(), field.view_mut());
        (own.march.near, own.march.far) = (view.march.near, view.march.far);
        own.background = view.background;
        Ok(Box::new(field))
    }
}
