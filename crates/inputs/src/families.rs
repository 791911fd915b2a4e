//! The families of models, told by the keys of their files.

use super::checkpoint::{self, unwrapped};
use super::options::{MlpChoice, SourceOptions};
use super::other_models;
use super::scale::rescale;
use super::source::{Family, Source};
use super::tensor::TensorFile;
use super::{dvgo, merf, ngp, plenoctree, plenoxels, sampled, snerg, tensorf, vdb};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::Limits;

/// The name of unpacked containers in errors.
pub const UNPACKED: &str = "an unpacked container";

/// A family with keys that no other has.
struct Reader {
    family: Family,
    /// True for files that this family wrote.
    knows: fn(&TensorFile) -> bool,
    /// Reads settings; grids stay in the file.
    open: fn(&TensorFile, &SourceOptions, &Limits) -> Result<Source>,
}

/// All but Mip-VoG, and DirectVoxGO with a network once a ray, to which every other file is held.
const READERS: [Reader; 10] = [
    Reader { family: Family::PlenOctree, knows: plenoctree::knows, open: plenoctree::open_tensors },
    Reader { family: Family::Plenoxels, knows: plenoxels::knows, open: plenoxels::open_tensors },
    Reader { family: Family::Sampled, knows: sampled::knows, open: sampled::open_tensors },
    Reader { family: Family::Dvgo, knows: dvgo::knows, open: dvgo::open_tensors },
    Reader { family: Family::Merf, knows: merf::knows, open: merf::open_tensors },
    Reader { family: Family::Snerg, knows: snerg::knows, open: snerg::open_tensors },
    Reader { family: Family::Vdb, knows: vdb::knows, open: vdb::open_tensors },
    Reader { family: Family::InstantNgp, knows: ngp::knows_snapshot, open: ngp::open_snapshot },
    Reader { family: Family::TorchNgp, knows: ngp::knows_checkpoint, open: ngp::open_checkpoint },
    Reader { family: Family::Tensorf, knows: tensorf::knows, open: tensorf::open_tensors },
];

fn reader(file: &TensorFile) -> Option<&'static Reader> {
    READERS.iter().find(|reader| (reader.knows)(file))
}

/// Refuses an unpacked container: its levels are no model, and are shown once they are packed.
fn refuse_unpacked(file: &TensorFile) -> Result<()> {
    match file.unpacked_metadata() {
        None => Ok(()),
        Some(_) => Err(Error::wrong_kind(UNPACKED, "a model or a container")),
    }
}

/// The family that wrote a file, if its keys alone tell.
pub fn family(file: &TensorFile) -> Option<Family> {
    reader(&unwrapped(file)).map(|reader| reader.family)
}

/// An error of a reader, by its cause: a value that is not read is no fault of its shape or type.
fn by_cause(error: Error, file: &TensorFile) -> Error {
    let is_fault =
        matches!(error.kind(), ErrorKind::Malformed { .. } | ErrorKind::WrongKind { .. });
    let value = file.root.at_place(error.place()).filter(|_| is_fault);
    let cause = value.and_then(|value| value.unread_error(error.place().clone()));
    cause.unwrap_or(error)
}

/// Opens a file by the reader of its family.
fn read(
    reader: Option<&Reader>,
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    let source = match reader {
        Some(reader) => (reader.open)(file, options, limits),
        None => other_models::refuse(file)
            .and_then(|()| checkpoint::open_tensors(file, options, limits)),
    };
    source.map_err(|error| by_cause(error, file))
}

/// Opens a model of any family.
///
/// # Errors
/// Those of the family, and settings out of their range.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    options.check()?;
    let file = &*unwrapped(file);
    let reader = reader(file);
    let in_file = |error: Error| error.in_file(file.file.path());
    refuse_unpacked(file).map_err(in_file)?;
    refuse_ignored(reader.map(|reader| reader.family), options).map_err(in_file)?;
    let source = read(reader, file, options, limits).map_err(in_file)?;
    let takes_resolution = source.family.is_sampled() || plenoxels::takes_resolution(file);
    if options.resolution.is_some() && !takes_resolution {
        let message = format!(
            "--resolution samples models without nodes (Instant-NGP, torch-ngp), and states those of \
             PeRFception's Plenoxels; a {} model has its own",
            source.family.name()
        );
        return Err(in_file(Error::usage(message)));
    }
    rescale(source, options).map_err(in_file)
}

/// Refuses options of checkpoints that a family, told by its keys, has no use for.
fn refuse_ignored(family: Option<Family>, options: &SourceOptions) -> Result<()> {
    let Some(family) = family.filter(|family| *family != Family::Dvgo) else { return Ok(()) };
    // The others say themselves what they make of a network.
    let has_no_network = matches!(
        family,
        Family::Plenoxels | Family::PlenOctree | Family::Tensorf | Family::Sampled
    );
    let ignored = [
        ("--mlp", has_no_network && options.mlp != MlpChoice::Auto),
        ("--coarse", options.coarse.is_some()),
    ];
    match ignored.into_iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((option, _)) => {
            let message = format!(
                "{option} belongs to checkpoints of Mip-VoG and DirectVoxGO, and this is a {} model",
                family.name()
            );
            Err(Error::usage(message))
        }
    }
}

/// A model of any family as a bake takes it, and the nodes of its free-space mask; the mask's values
/// are not read where that can be spared.
///
/// # Errors
/// Those of [`open_tensors`].
pub(super) fn describe(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<(Source, Option<[usize; 3]>)> {
    refuse_unpacked(file)?;
    let file = &*unwrapped(file);
    let Some(reader) = reader(file) else {
        other_models::refuse(file)?;
        let described = checkpoint::describe(file, options, limits);
        let (source, mask) = described.map_err(|error| by_cause(error, file))?;
        return Ok((rescale(source, options)?, mask));
    };
    options.check()?;
    let source = read(Some(reader), file, options, limits)?;
    let mask = source.field.free_space.as_ref().map(|mask| mask.nodes.0);
    Ok((rescale(source, options)?, mask))
}
