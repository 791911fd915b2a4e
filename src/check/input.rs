//! Findings in an input of a bake: in the file, its scene, and the health of its values.

use std::sync::Arc;

use super::health::{self, Health};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked};
use crate::base::limits::Limits;
use crate::model::field::RadianceField;
use mipvog_inputs::SourceOptions;
use mipvog_inputs::tensor::{self, TensorFile};

/// Reports all faults of a file of tensors. Returns the statistics of its values, if they can be
/// read.
pub fn check(
    file: Arc<SourceFile>,
    options: &SourceOptions,
    limits: &Limits,
    report: &mut Report,
) -> Result<Option<Health>> {
    let tensors = tensor::open_file(&file, limits);
    let Some(tensors) = checked(tensors, Code::Input, report)? else { return Ok(None) };
    let opened = match tensors.unpacked_metadata() {
        Some(_) => unpacked(&tensors, limits),
        None => trained(&tensors, options, limits, report),
    };
    match opened {
        Ok(field) => health::check(&field, report),
        // A fault of another file, which an option names, is not a fault of this one.
        Err(error)
            if matches!(error.kind(), ErrorKind::Io(_))
                && error.file().is_some_and(|path| path != file.path()) =>
        {
            Err(error)
        }
        Err(error) => {
            // An unreadable file has the code of its syntax; a readable file may still not be a
            // scene.
            let code = match error.kind() {
                ErrorKind::Io(_) | ErrorKind::Truncated { .. } | ErrorKind::Checksum { .. } => {
                    Code::Input
                }
                _ => Code::Scene,
            };
            report(Finding { code, error })?;
            Ok(None)
        }
    }
}

/// Level 0 of an unpacked container.
fn unpacked(tensors: &TensorFile, limits: &Limits) -> Result<RadianceField> {
    let field = mipvog_inputs::unpacked::open(tensors, limits)?.field(limits)?;
    field.ok_or_else(|| Error::malformed(Place::File, "no densities of level 0", "some"))
}

/// A checkpoint, opened as for a bake.
fn trained(
    tensors: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
    report: &mut Report,
) -> Result<RadianceField> {
    let source = mipvog_inputs::open_tensors(tensors, options, limits)?;
    for assumption in source.assumptions {
        let place = Place::Key(assumption.key.to_owned());
        // The sentence for users names the missing setting and its option.
        let error = Error::new(ErrorKind::Usage { message: assumption.message }, place);
        report(Finding { code: Code::Unstated, error })?;
    }
    Ok(source.field)
}
