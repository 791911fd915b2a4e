//! Reads a folder back by its viewer's rules.

use std::path::Path;

use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::export_files::WrittenFiles;
use crate::view::render::{Renderer, View};
use mipvog_inputs::snerg::layout::PARAMETERS;
use mipvog_inputs::{SourceOptions, open_with};

/// Opens files without names, via a folder of links with their names.
pub(super) fn read_back(view: &View, files: &WrittenFiles, limits: &Limits) -> Result<Renderer> {
    let folder = files.linked()?;
    let path: &Path = folder.path();
    let options = SourceOptions { background: Some(view.background), ..SourceOptions::default() };
    let source = open_with(&path.join(PARAMETERS), &options, limits)?;
    let Some(model) = &source.model else {
        return Err(Error::usage("a SNeRG folder has rules of its own"));
    };
    // The atlas is read into memory, because the links are removed after this.
    Ok(Renderer::with_view(view, model.load(limits)?))
}
