//! Input files, which must not be replaced: those in the arguments, and those that they refer to.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::base::bytes::{Guard, SourceFile, is_guarded};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::model::camera;
use mipvog_outputs::gltf::asset::{Asset, is_asset};
use mipvog_outputs::gltf::attach::companion_paths;

/// Guards the file at a path, the files that it names if it is a glTF asset, and the pictures that
/// it names if it is a camera file.
pub fn guards(path: &Path) -> Vec<Guard> {
    let named = named(path).unwrap_or_default();
    named.iter().map(PathBuf::as_path).chain([path]).filter_map(Guard::of).collect()
}

fn named(path: &Path) -> Option<Vec<PathBuf>> {
    let limits = Limits::default();
    let file = Arc::new(SourceFile::open(path).ok().filter(is_asset)?);
    if let Ok(asset) = Asset::open(file, &limits) {
        return companion_paths(&asset).ok();
    }
    let file = camera::read(path, None, &limits).ok()?;
    Some(file.pictures().collect())
}

/// Refuses an output that is one of the inputs, by whatever name.
///
/// # Errors
///
/// [`ErrorKind::IsInput`].
pub fn refuse_inputs<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: &[PathBuf],
) -> Result<()> {
    let _guards: Vec<Guard> = inputs.iter().filter_map(|path| Guard::of(path)).collect();
    match outputs.into_iter().find(|path| is_guarded(path)) {
        Some(path) => Err(Error::new(ErrorKind::IsInput, Place::File).in_file(path)),
        None => Ok(()),
    }
}
