//! Opens a folder's core as a field, and as a model with its own rules.

use std::sync::Arc;

use super::model::FolderModel;
use super::parameters::{KEYS, Parameters};
use super::sums::Assets;
use super::values::{ColorValues, DensityValues};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{self, Folder, read_network};
use crate::model::field::{ColorDomain, Grid, RadianceField};
use crate::model::view_dependence::ViewDependence;
use crate::options::SourceOptions;
use crate::snerg::layout::FEATURES;
use crate::source::{Family, Source};
use crate::tensor::{FileKind, TensorFile};

/// True for the parameters of MERF's folders.
pub fn knows(file: &TensorFile) -> bool {
    let stated = |key: &str| file.root.get(key).is_some_and(|value| !value.is_none());
    file.kind == FileKind::Folder && KEYS.iter().any(|key| stated(key))
}

/// Opens a folder: reads its parameters and looks at its pictures.
///
/// # Errors
/// `Unsupported` unless the surroundings are to be left out, and for SMERF; `Malformed` where
/// numbers and pictures do not fit each other; `Io` where a picture is missing.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    folder::refuse_other_views("MERF", options)?;
    let parameters = Parameters::read(file, limits)?;
    if !options.drop_background {
        let found = "a MERF scene in contracted space, whose rays are not straight beyond its core";
        let expected = "a grid in a box, or option --drop-background, which keeps the core alone, \
                        the box from -1 to 1";
        return Err(Error::unsupported(Place::File, found, expected));
    }
    let stored = read_network(file, &mut Budget::new(limits))?;
    let network = stored.filter(|_| !folder::drops_network(options));
    let place = Place::Key("resolution".to_owned());
    let scene = folder::scene(&parameters.cells(), options, &place)?;
    let of = Folder::of(file.file.path());
    let (assets, side_files) = Assets::find(of, parameters, limits)?;
    let assets = Arc::new(assets);
    let channels = if network.is_some() { 3 + FEATURES } else { 3 };
    let colors = ColorValues::new(Arc::clone(&assets), channels);
    let field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(DensityValues(Arc::clone(&assets)))),
        color: vec![Grid::Values(Arc::new(colors))],
        color_domain: ColorDomain::Logit,
        view: network.clone().map(ViewDependence::Network),
        free_space: None,
        shells: Vec::new(),
    };
    field.check()?;
    Ok(Source {
        field,
        assumptions: network.iter().map(|_| folder::assumption("MERF")).collect(),
        model: Some(Arc::new(FolderModel { assets, network })),
        family: Family::Merf,
        kind: file.kind,
        has_checksums: file.has_checksums,
        scene_scale: 1.0,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    })
}
