//! Opens a folder.

use std::sync::Arc;

use super::assets::Assets;
use super::parameters::Parameters;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{self, Folder, Found, InputOrder};
use crate::merf;
use crate::options::SourceOptions;
use crate::source::{Family, Source};
use crate::tensor::{FileKind, TensorFile};

/// True for the parameters of a folder, other than those of MERF.
pub fn knows(file: &TensorFile) -> bool {
    file.kind == FileKind::Folder && !merf::knows(file)
}

/// Opens a folder: reads its parameters, checks its pictures, and reads the index picture.
///
/// # Errors
/// `Unsupported` for scenes that are not a box of cubes, `Malformed` for inconsistent numbers and
/// pictures, `Io` for missing pictures.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let family = Family::Snerg;
    folder::refuse_other_views(family.name(), options)?;
    let parameters = Parameters::read(file, limits)?;
    let stored = folder::read_network(file, InputOrder::DirectionFirst, &mut Budget::new(limits))?;
    let place = Place::Key("grid_width".to_owned());
    let scene = folder::scene(&parameters.cells(), options, &place)?;
    let of = Folder::of(file.file.path());
    let (assets, side_files) = Assets::find(of, parameters, stored.is_some(), limits)?;
    let network = stored.filter(|_| !folder::drops_network(options));
    folder::source(file, Found { family, scene, assets: Arc::new(assets), network, side_files })
}
