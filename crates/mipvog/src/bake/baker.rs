//! The front door: a bake into memory, into a writer or into a file.

use std::io::Write;
use std::path::Path;

use super::{BakeOptions, BakeReport, Origin, bake};
use crate::base::bytes::{ByteSink, Output, WriterSink};
use crate::base::error::Result;
use crate::base::progress::{Progress, Silent};
use crate::model::field::RadianceField;

/// A field to bake, and its origin for the container's provenance.
#[derive(Debug)]
pub struct BakeInput<'a> {
    /// The field.
    pub field: &'a RadianceField,
    /// Its origin.
    pub origin: Origin,
}

impl<'a> From<&'a RadianceField> for BakeInput<'a> {
    fn from(field: &'a RadianceField) -> Self {
        Self { field, origin: Origin::of_arrays() }
    }
}

/// Bakes fields with one set of options.
///
/// ```
/// use mipvog::{BakeOptions, Baker, Container, RadianceField};
///
/// let field = RadianceField::builder([4; 3], vec![5.0; 64], vec![0.0; 192]).build()?;
/// let bytes = Baker::new(BakeOptions::default().with_levels(2)).to_vec(&field)?;
/// let container = Container::from_bytes(bytes, &Default::default())?;
/// assert_eq!(container.metadata().levels.len(), 2);
/// # Ok::<(), mipvog::Error>(())
/// ```
pub struct Baker<'a> {
    options: BakeOptions,
    progress: &'a dyn Progress,
}

impl<'a> Baker<'a> {
    /// A baker with these options, which reports no progress.
    pub fn new(options: BakeOptions) -> Self {
        Self { options, progress: &Silent }
    }

    /// Reports progress to `progress`, which may also request a stop.
    #[must_use]
    pub fn progress(self, progress: &'a dyn Progress) -> Self {
        Self { progress, ..self }
    }

    /// Bakes into memory: the bytes of a `.mipvog` container.
    ///
    /// # Errors
    ///
    /// Options that contradict each other or the field; an input that cannot be read; values that
    /// are not finite, if these are refused; and a request to stop.
    pub fn to_vec<'f>(&self, input: impl Into<BakeInput<'f>>) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.to_writer(input, &mut bytes)?;
        Ok(bytes)
    }

    /// Bakes into any writer.
    ///
    /// # Errors
    ///
    /// As [`Self::to_vec`], and errors of the writer.
    pub fn to_writer<'f>(
        &self,
        input: impl Into<BakeInput<'f>>,
        writer: impl Write,
    ) -> Result<BakeReport> {
        self.run(input.into(), &mut WriterSink::new(writer))
    }

    /// Bakes into a file, which is complete or absent. An existing file is refused unless
    /// `overwrite` is true.
    ///
    /// # Errors
    ///
    /// As [`Self::to_vec`], and errors of writing the file.
    pub fn to_file<'f>(
        &self,
        input: impl Into<BakeInput<'f>>,
        path: impl AsRef<Path>,
        overwrite: bool,
    ) -> Result<BakeReport> {
        let mut output = Output::create(path.as_ref(), overwrite)?;
        let report = self.run(input.into(), &mut output)?;
        output.finish()?;
        Ok(report)
    }

    fn run(&self, input: BakeInput, sink: &mut dyn ByteSink) -> Result<BakeReport> {
        bake(input.field, &self.options, &input.origin, sink, self.progress)
    }
}
