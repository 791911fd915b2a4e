//! The families of models, recognized by the keys of their files.

use super::checkpoint::{self, unwrapped};
use super::options::{AppearanceChoice, MlpChoice, SourceOptions};
use super::other_models;
use super::scale::rescale;
use super::source::{Family, Source};
use super::tensor::TensorFile;
use super::{
    dvgo, merf, nerfacto, ngp, plenoctree, plenoxels, sampled, snerg, svraster, tensorf, vdb,
};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::Limits;

/// The name of unpacked containers in errors.
pub const UNPACKED: &str = "an unpacked container";

/// A family, and its places in the repository.
#[derive(Debug, Clone, Copy)]
pub struct Registered {
    /// The family.
    pub family: Family,
    /// Its section in `docs/models.md`, or in `docs/inputs.md`.
    pub docs: &'static str,
    /// The fuzz target that generates its files.
    pub fuzz: &'static str,
}

/// A family with keys that no other has.
struct Reader {
    registered: Registered,
    /// True for files that this family wrote.
    knows: fn(&TensorFile) -> bool,
    /// Reads settings; grids stay in the file.
    open: Open,
}

type Open = fn(&TensorFile, &SourceOptions, &Limits) -> Result<Source>;

const fn row(
    family: Family,
    docs: &'static str,
    fuzz: &'static str,
    knows: fn(&TensorFile) -> bool,
    open: Open,
) -> Reader {
    Reader { registered: Registered { family, docs, fuzz }, knows, open }
}

/// All families except Mip-VoG and DirectVoxGO with a network per ray, which are the fallback. A
/// test compares the rows with the documentation, the fuzz targets and the schema of `inspect`.
const READERS: [Reader; 12] = [
    row(Family::PlenOctree, "plenoctrees", "grids", plenoctree::knows, plenoctree::open_tensors),
    row(Family::Plenoxels, "plenoxels", "grids", plenoxels::knows, plenoxels::open_tensors),
    row(Family::SvRaster, "svraster", "models", svraster::knows, svraster::open_tensors),
    row(Family::Sampled, "sampled-arrays", "grids", sampled::knows, sampled::open_tensors),
    row(Family::Dvgo, "directvoxgo", "models", dvgo::knows, dvgo::open_tensors),
    row(Family::Merf, "merf-folders", "merf", merf::knows, merf::open_tensors),
    row(Family::Snerg, "snerg-folders", "snerg", snerg::knows, snerg::open_tensors),
    row(Family::Vdb, "openvdb", "vdb", vdb::knows, vdb::open_tensors),
    row(
        Family::InstantNgp,
        "instant-ngp-and-torch-ngp",
        "snapshot",
        ngp::knows_snapshot,
        ngp::open_snapshot,
    ),
    row(
        Family::TorchNgp,
        "instant-ngp-and-torch-ngp",
        "models",
        ngp::knows_checkpoint,
        ngp::open_checkpoint,
    ),
    row(Family::Nerfacto, "nerfacto", "models", nerfacto::knows, nerfacto::open_tensors),
    row(Family::Tensorf, "tensorf", "models", tensorf::knows, tensorf::open_tensors),
];

/// Every family.
pub fn registered() -> impl Iterator<Item = Registered> {
    let rest =
        Registered { family: Family::MipVog, docs: "what-is-read-of-a-checkpoint", fuzz: "pickle" };
    READERS.iter().map(|reader| reader.registered).chain([rest])
}

fn reader(file: &TensorFile) -> Option<&'static Reader> {
    READERS.iter().find(|reader| (reader.knows)(file))
}

/// Refuses an unpacked container: its levels are not a model, and must be packed first.
fn refuse_unpacked(file: &TensorFile) -> Result<()> {
    match file.unpacked_metadata() {
        None => Ok(()),
        Some(_) => Err(Error::wrong_kind(UNPACKED, "a model or a container")),
    }
}

/// The family that wrote a file, if its keys are unique to it.
pub fn family(file: &TensorFile) -> Option<Family> {
    reader(&unwrapped(file)).map(|reader| reader.registered.family)
}

/// An error of a reader, corrected for its cause: for an unread value, the shape or type is not at
/// fault.
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
    refuse_ignored(reader.map(|reader| reader.registered.family), options).map_err(in_file)?;
    let source = read(reader, file, options, limits).map_err(in_file)?;
    refuse_extent(&source, options).map_err(in_file)?;
    let takes_resolution = source.family.is_sampled()
        || source.is_unbounded
        || source.family == Family::SvRaster
        || plenoxels::takes_resolution(file);
    if options.resolution.is_some() && !takes_resolution {
        let message = format!(
            "--resolution samples models without nodes (Instant-NGP, torch-ngp, nerfacto), octrees of \
             voxels (SVRaster) and unbounded scenes, and states the cells of PeRFception's Plenoxels; \
             a {} model has its own",
            source.family.name()
        );
        return Err(in_file(Error::usage(message)));
    }
    rescale(source, options).map_err(in_file)
}

/// Refuses an extent for a scene that has none.
fn refuse_extent(source: &Source, options: &SourceOptions) -> Result<()> {
    if options.extent.is_none() || source.is_unbounded {
        return Ok(());
    }
    Err(Error::usage(match options.drop_background {
        true => {
            "--extent says how far an unbounded scene is kept, and --drop-background keeps its inner \
             box alone: state one of them"
                .to_owned()
        }
        false => format!(
            "--extent says how far an unbounded scene is kept, and this {} model ends at its box",
            source.family.name()
        ),
    }))
}

/// Refuses options of checkpoints that do not apply to the family.
fn refuse_ignored(family: Option<Family>, options: &SourceOptions) -> Result<()> {
    if options.appearance != AppearanceChoice::Auto && family != Some(Family::Nerfacto) {
        let name = family.map_or("checkpoint without appearances", Family::name);
        let message = format!(
            "--appearance chooses between the appearances of a nerfacto model, and this is a {name}"
        );
        return Err(Error::usage(message));
    }
    if options.grid.is_some() && family != Some(Family::Vdb) {
        let name = family.map_or("a checkpoint", Family::name);
        let message = format!("--grid names a grid of an OpenVDB file, and this is {name}");
        return Err(Error::usage(message));
    }
    let Some(family) = family.filter(|family| *family != Family::Dvgo) else { return Ok(()) };
    // The other families check network options themselves.
    let has_no_network = matches!(
        family,
        Family::Plenoxels
            | Family::PlenOctree
            | Family::Tensorf
            | Family::Sampled
            | Family::SvRaster
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

/// A model of any family for a bake, and the nodes of its free-space mask, whose values are read
/// only if needed.
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
