//! A small picture of the scene in its container.

use std::path::Path;
use std::sync::Arc;

use clap::Args;

use super::output::create_container;
use crate::base::bytes::{Output, SourceFile};
use crate::base::error::{Place, Result};
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::container::{Container, thumbnail_size, with_thumbnail};
use crate::view::overview_png;
use crate::view::render::Renderer;

/// A thumbnail of the output.
#[derive(Debug, Clone, Copy, Args)]
pub struct ThumbnailArguments {
    /// Put a square picture of the scene into the container, this many pixels wide, for file
    /// managers and asset libraries; inspect --thumbnail extracts it
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u16).range(16..=1024))]
    thumbnail: Option<u16>,
}

impl ThumbnailArguments {
    /// True if the container has the requested thumbnail, or none is requested.
    pub fn is_in(self, container: &Container) -> bool {
        let Some(side) = self.thumbnail.map(usize::from) else { return true };
        let place = Place::File;
        let size = |png: Vec<u8>| thumbnail_size(&png, &place).ok();
        container.thumbnail().is_ok_and(|png| png.and_then(size) == Some([side; 2]))
    }

    /// The written container with its thumbnail, if requested.
    ///
    /// # Errors
    /// Those of reading, rendering and writing.
    pub fn add(
        self,
        written: Output,
        path: &Path,
        replace: bool,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Output> {
        let Some(side) = self.thumbnail.map(usize::from) else { return Ok(written) };
        let container = Container::open(Arc::new(SourceFile::open(written.written())?), limits)?;
        let png = overview_png(&Renderer::of_container(&container)?, [side; 2], progress)?;
        let mut output = create_container(path, replace)?;
        with_thumbnail(&container, png, &mut output)?;
        Ok(output)
    }
}
