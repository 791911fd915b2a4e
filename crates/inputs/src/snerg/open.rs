//! Opens a folder as a field, and as a model with its own rules.

use std::sync::Arc;

use super::atlas::Places;
use super::files::Pictures;
use super::model::FolderModel;
use super::parameters::Parameters;
use super::values::{ColorValues, DensityValues, Folder};
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{self, read_network};
use crate::merf;
use crate::model::field::{ColorDomain, Grid, RadianceField};
use crate::model::view_dependence::ViewDependence;
use crate::options::SourceOptions;
use crate::snerg::layout::FEATURES;
use crate::source::{Family, Source};
use crate::tensor::{FileKind, TensorFile};

/// True for the parameters of a folder, other than those of MERF.
pub fn knows(file: &TensorFile) -> bool {
    file.kind == FileKind::Folder && !merf::knows(file)
}

/// Opens a folder: reads its parameters, looks at its pictures, and reads the one of indices.
///
/// # Errors
/// `Unsupported` for scenes that are no box of cubes, `Malformed` where numbers and pictures do not
/// fit each other, `Io` where a picture is missing.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    folder::refuse_other_views("SNeRG", options)?;
    let parameters = Parameters::read(file, limits)?;
    let stored = read_network(file, &mut Budget::new(limits))?;
    let folder = folder::Folder::of(file.file.path());
    let (pictures, side_files) = Pictures::find(folder, &parameters, stored.is_some())?;
    let places = Places::read(&pictures, &parameters, limits)?;
    let network = stored.filter(|_| !folder::drops_network(options));
    let assumptions = network.iter().map(|_| folder::assumption("SNeRG")).collect();
    let place = Place::Key("grid_width".to_owned());
    let scene = folder::scene(&parameters.cells(), options, &place)?;
    let folder = Arc::new(Folder::new(parameters, pictures, places, limits));
    let channels = if network.is_some() { 3 + FEATURES } else { 3 };
    let colors = ColorValues::new(Arc::clone(&folder), channels);
    let field = RadianceField {
        scene,
        density: Grid::Values(Arc::new(DensityValues(Arc::clone(&folder)))),
        color: vec![Grid::Values(Arc::new(colors))],
        color_domain: ColorDomain::Logit,
        view: network.clone().map(ViewDependence::Network),
        free_space: None,
        shells: Vec::new(),
    };
    field.check()?;
    Ok(Source {
        field,
        model: Some(Arc::new(FolderModel { folder, network })),
        family: Family::Snerg,
        kind: file.kind,
        has_checksums: file.has_checksums,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    })
}
