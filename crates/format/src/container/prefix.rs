//! Containers truncated after a level: their coarsest levels.

use std::ops::Range;
use std::sync::Arc;

use super::Container;
use super::layout::TABLE;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::model::baked::{BakedField, Metadata};

/// A container whose finest levels may be missing. The parts that are present follow the same rules
/// as in a complete file.
#[derive(Debug)]
pub struct Prefix {
    container: Container,
    finest: usize,
}

impl Container {
    /// Opens a container that is complete or ends at a level's prefix.
    ///
    /// # Errors As [`Self::open`], and `Truncated` if the file ends anywhere else. `wanted` is then
    /// the shortest prefix that renders a level, or the next finer level.
    pub fn read_prefix(file: Arc<SourceFile>, limits: &Limits) -> Result<Prefix> {
        let path = file.path().to_owned();
        let container = Self::open_prefix(file, limits)?;
        let finest = container.finest_whole_level().map_err(|error| error.in_file(&path))?;
        Ok(Prefix { container, finest })
    }

    /// The finest complete level of the file.
    fn finest_whole_level(&self) -> Result<usize> {
        let length = self.file().length();
        let prefixes: Vec<u64> = (0..self.metadata().levels.len())
            .map(|level| self.entry(TABLE, Some(level)).map_or(u64::MAX, |table| table.prefix))
            .collect();
        if length == self.header().file_length {
            return Ok(0);
        }
        if let Some(finest) = prefixes.iter().position(|&prefix| prefix == length) {
            return Ok(finest);
        }
        if length > self.header().file_length {
            let found = format!("{} bytes after the end", length - self.header().file_length);
            return Err(Error::malformed(Place::File, found, "nothing there"));
        }
        let wanted = prefixes.into_iter().filter(|&prefix| prefix > length).min();
        let wanted = wanted.unwrap_or(self.header().file_length);
        Err(Error::new(ErrorKind::Truncated { wanted, left: length }, Place::File))
    }
}

impl Prefix {
    /// The directory and metadata of the complete file. Missing levels cannot be read.
    pub fn container(&self) -> &Container {
        &self.container
    }

    /// The metadata of the complete file.
    pub fn metadata(&self) -> &Metadata {
        self.container.metadata()
    }

    /// The missing levels, finest first; empty for a complete file.
    pub fn missing(&self) -> Range<usize> {
        0..self.finest
    }

    /// Decodes the levels that are present. Missing levels have no blocks, nor does their metadata
    /// state any. Renderers start at [`BakedField::finest`].
    ///
    /// # Errors
    /// The first rule of the specification that the content violates.
    pub fn read(&self) -> Result<BakedField> {
        self.container.read_from(self.finest)
    }
}
