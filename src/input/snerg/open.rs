//! Opens a folder as a field, and as a model with its own rules.

use std::path::Path;
use std::sync::Arc;

use super::atlas::Places;
use super::files::Pictures;
use super::model::FolderModel;
use super::network;
use super::parameters::Parameters;
use super::values::{ColorValues, DensityValues, Folder};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::input::source::{Assumption, Family, Source};
use crate::input::tensor::{FileKind, TensorFile};
use crate::model::field::{
    Activation, ActivationOrder, ColorDomain, DensityFunction, Grid, March, RadianceField, Scene,
};
use crate::model::snerg::{FAINT, FEATURES};
use crate::model::view_dependence::ViewDependence;

/// True for the parameters of a folder. Those of SNeRG's successors are refused by name.
pub fn knows(file: &TensorFile) -> bool {
    file.kind == FileKind::Folder
}

/// Opens a folder: reads its parameters, looks at its pictures, and reads the one of indices.
///
/// # Errors
/// `Unsupported` for scenes that are no box of cubes, `Malformed` where numbers and pictures do not
/// fit each other, `Io` where a picture is missing.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if let (ViewChoice::Harmonics(_), _) | (_, MlpChoice::File(_)) = (options.view, &options.mlp) {
        return Err(Error::usage(
            "a SNeRG folder has its own network, once a ray: --view takes keep or none, --mlp \
             auto or none",
        ));
    }
    let parameters = Parameters::read(file, limits)?;
    let stored = network::read(file, &mut Budget::new(limits))?;
    let folder = file.file.path().parent().unwrap_or(Path::new(""));
    let (pictures, companions) = Pictures::find(folder, &parameters, stored.is_some())?;
    let places = Places::read(&pictures, &parameters, limits)?;
    let dropped = options.view == ViewChoice::None || options.mlp == MlpChoice::None;
    let network = stored.filter(|_| !dropped);
    let mut assumptions = Vec::new();
    if network.is_some() {
        assumptions.push(Assumption {
            key: "background",
            value: "before the network".to_owned(),
            message:
                "SNeRG's viewer adds the background before the network runs, and does not run \
                      it where a ray meets nothing; a container adds it after, to every ray: \
                      half-transparent pixels of a bake differ, and a background that is not white \
                      may be brightened; compare measures it"
                    .to_owned(),
        });
    }
    let (cells, grid_place) = (parameters.cells(), Place::Key("grid_width".to_owned()));
    let stepsize = options.stepsize.unwrap_or(1.0);
    let (order, function) = (ActivationOrder::Opacity, DensityFunction::Softplus);
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let march = March {
        stepsize,
        voxel_size: cells.voxel_size(),
        near: 0.0,
        far: None,
        color_threshold: options.color_threshold.unwrap_or(0.0),
        alpha_threshold: FAINT as f32,
        sampled: Some(cells.faces()),
        voxel: None,
    };
    let scene = Scene {
        bounds: cells.bounds(&grid_place)?,
        nodes: cells.nodes(),
        activation: Activation { shift: 0.0, interval: stepsize, order, function },
        march,
        background: options.background.unwrap_or([1.0; 3]),
    };
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
    };
    field.check()?;
    Ok(Source {
        field,
        model: Some(Arc::new(FolderModel { folder, network })),
        family: Family::Snerg,
        kind: file.kind,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        companions,
    })
}
