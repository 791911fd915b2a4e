//! Opens a folder's core.

use std::sync::Arc;

use super::parameters::{KEYS, Parameters};
use super::sums::Assets;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{self, Folder, Found};
use crate::options::SourceOptions;
use crate::source::{Family, Source};
use crate::tensor::{FileKind, TensorFile};

/// True for the parameters of MERF's folders.
pub fn knows(file: &TensorFile) -> bool {
    let stated = |key: &str| file.root.get(key).is_some_and(|value| !value.is_none());
    file.kind == FileKind::Folder && KEYS.iter().any(|key| stated(key))
}

/// Opens a folder: reads its parameters, looks at its pictures, and reads the one of indices.
///
/// # Errors
/// `Unsupported` unless the surroundings are to be left out, and for SMERF; `Malformed` where
/// numbers and pictures do not fit each other; `Io` where a picture is missing.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let family = Family::Merf;
    folder::refuse_other_views(family.name(), options)?;
    let parameters = Parameters::read(file, limits)?;
    if !options.drop_background {
        let found = "a MERF scene in contracted space, whose rays are not straight beyond its core";
        let expected = "a grid in a box, or option --drop-background, which keeps the core alone, \
                        the box from -1 to 1";
        return Err(Error::unsupported(Place::File, found, expected));
    }
    let stored = folder::read_network(file, &mut Budget::new(limits))?;
    let network = stored.filter(|_| !folder::drops_network(options));
    let place = Place::Key("resolution".to_owned());
    let scene = folder::scene(&parameters.cells(), options, &place)?;
    let (assets, side_files) = Assets::find(Folder::of(file.file.path()), parameters, limits)?;
    folder::source(file, Found { family, scene, assets: Arc::new(assets), network, side_files })
}
