//! Validates a file of any kind.

use std::path::Path;
use std::sync::Arc;

use super::report::Report;
use super::{asset, input};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::finding::{Code, Finding, checked};
use crate::base::limits::Limits;
use crate::container::{Container, starts_container};
use mipvog_inputs::SourceOptions;
use mipvog_inputs::{file_of, tensor};
use mipvog_outputs::gltf::asset::is_asset;

/// Options of validation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CheckOptions {
    /// Maximum number of listed findings; more are only counted. Default: 1000
    pub max_findings: usize,
    /// The user's settings for an input of a bake. Default: none
    pub source: SourceOptions,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { max_findings: 1000, source: SourceOptions::default() }
    }
}

/// Validates a container, a glTF asset with the containers of its radiance fields, or an input of a
/// bake.
///
/// # Errors
/// The file cannot be opened or read at all. Faults of its bytes are in the report.
pub fn check(path: &Path, limits: &Limits) -> Result<Report> {
    check_with(path, &CheckOptions::default(), limits)
}

/// Validates a file with options; see [`check`].
///
/// # Errors
/// As [`check`], and `Usage` for options out of range.
pub fn check_with(path: &Path, options: &CheckOptions, limits: &Limits) -> Result<Report> {
    check_file(Arc::new(SourceFile::open(&file_of(path))?), options, limits)
}

/// Validates an open file; see [`check_with`].
///
/// # Errors
/// As [`check_with`].
pub fn check_file(
    file: Arc<SourceFile>,
    options: &CheckOptions,
    limits: &Limits,
) -> Result<Report> {
    options.source.check()?;
    let mut report = Report::new(options.max_findings);
    let mut add = |finding: Finding| {
        report.add(&finding);
        Ok(())
    };
    if is_asset(&file) {
        asset::check(file, limits, &mut add)?;
    } else if starts_container(&file) {
        let container = Container::walk(file, limits, &mut add);
        if let Some(Some(container)) = checked(container, Code::File, &mut add)? {
            checked(container.check_contents(&mut add), Code::File, &mut add)?;
        }
    } else if tensor::is_tensors(&file)? {
        report.health = input::check(file, &options.source, limits, &mut add)?;
    } else {
        let found = tensor::describe(&file)?;
        let expected = "a container, a glTF asset, or a file of tensors";
        add(Finding { code: Code::File, error: Error::wrong_kind(found, expected) })?;
    }
    Ok(report)
}
