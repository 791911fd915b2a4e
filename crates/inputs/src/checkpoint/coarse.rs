//! The coarse checkpoint, the only source of the rule from the mask's density to opacity.
//!
//! Only its settings are read (`MaskCache_kwargs` at its top level: `act_shift` and
//! `voxel_size_ratio`); its grids are not. A fine checkpoint has a dictionary of the same name, but
//! that one describes the fine model.

use std::path::{Path, PathBuf};

use super::march;
use super::names::NamedValues;
use super::wrappers::unwrapped;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::options::SourceOptions;
use crate::source::Assumption;
use crate::tensor;

/// Opacity that training of the coarse stage starts from.
const ALPHA_INIT: f64 = 1e-6;
/// The coarse checkpoint's usual name.
const FILE_NAME: &str = "coarse_last.tar";

/// The rules that turn the mask's density into opacity.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coarse {
    /// Added to raw density.
    pub(super) shift: f64,
    /// Interval of one voxel.
    pub(super) ratio: f64,
    /// The file that states it, with its digest; none if it was assumed.
    pub(super) file: Option<(PathBuf, [u8; 32])>,
}

/// Finds the coarse checkpoint of the fine one at `checkpoint`.
pub(super) fn find(
    names: &NamedValues<'_>,
    checkpoint: &Path,
    options: &SourceOptions,
    limits: &Limits,
    assumptions: &mut Vec<Assumption>,
) -> Result<Coarse> {
    if let Some(path) = &options.coarse {
        return read(path, limits).map_err(|error| error.in_file(path));
    }
    let mut failure = None;
    for path in candidates(names, checkpoint) {
        // A name from a checkpoint may be a device or a pipe.
        if !path.is_file() {
            continue;
        }
        match read(&path, limits) {
            Ok(coarse) => return Ok(coarse),
            Err(error) => failure = failure.or(Some(error.in_file(&path))),
        }
    }
    let reason = failure.map_or_else(
        || "the coarse checkpoint was not found".to_owned(),
        |error| format!("the coarse checkpoint could not be used ({error})"),
    );
    assumptions.push(Assumption {
        key: "coarse",
        value: format!("alpha_init {ALPHA_INIT:e}, voxel_size_ratio 1"),
        message: format!(
            "{reason}: assuming that its free-space mask was trained with alpha_init \
             {ALPHA_INIT:e} and a voxel size ratio of 1; a wrong guess leaves holes: pass the file \
             as option coarse"
        ),
    });
    Ok(Coarse { shift: march::shift(ALPHA_INIT, &Place::File)?, ratio: 1.0, file: None })
}

/// Candidate files, the likeliest first. A checkpoint states the path on the machine that trained
/// it. Only the file name of that path counts, beside the checkpoint: a file from elsewhere must
/// not choose which paths of this machine are opened.
fn candidates(names: &NamedValues<'_>, checkpoint: &Path) -> Vec<PathBuf> {
    let folder = checkpoint.parent().unwrap_or(Path::new(""));
    let stated = match names.setting("mask_cache_path") {
        // The training machine may have had other separators.
        Some(tensor::Value::Text(stated)) => stated.rsplit(['/', '\\', ':']).next(),
        _ => None,
    };
    let stated = stated.filter(|name| !["", ".", ".."].contains(name));
    stated.into_iter().chain([FILE_NAME]).map(|name| folder.join(name)).collect()
}

fn read(path: &Path, limits: &Limits) -> Result<Coarse> {
    let file = tensor::open(path, limits)?;
    let file = unwrapped(&file);
    let names = NamedValues::new(&file);
    let shift = match names.own_mask_number("act_shift")? {
        Some(shift) => shift,
        None => match names.number("alpha_init")? {
            Some(alpha_init) => march::shift(alpha_init, &Place::Key("alpha_init".into()))?,
            None => {
                return Err(Error::malformed(
                    Place::Key(super::names::AS_MASK.into()),
                    "neither act_shift nor alpha_init",
                    "a coarse checkpoint that says how its density becomes opacity",
                ));
            }
        },
    };
    march::narrow("act_shift", shift)?;
    let ratio = names.own_mask_number("voxel_size_ratio")?.unwrap_or(1.0);
    let ratio = march::positive("voxel_size_ratio", ratio)?;
    Ok(Coarse { shift, ratio, file: Some((path.to_owned(), file.digest)) })
}
