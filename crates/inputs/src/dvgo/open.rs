//! Opens a checkpoint whose network runs for every sample.

use std::sync::Arc;

use super::fitted::{OCTAVES, harmonics, network};
use super::model::DvgoFile;
use super::open_unbounded;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::checkpoint::{self, Inner, NamedValues, StoredGrid};
use crate::model::field::{ColorDomain, Grid, RadianceField};
use crate::model::view_dependence::ViewDependence;
use crate::network::{FittedColors, ProjectedColors, StoredFeatures, fit_assumption};
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Family, Source};
use crate::tensor::{Tensor, TensorFile};

/// Channels of `k0` for a network that runs once per ray.
const DEFERRED_CHANNELS: u64 = 7;

/// True for checkpoints of DirectVoxGO whose network takes the colours' features of each sample.
pub fn knows(file: &TensorFile) -> bool {
    let names = NamedValues::new(file);
    let signs = ["scene_center", "scene_radius"].iter().any(|name| names.weight(name).is_some());
    let contracted = signs || names.setting("contracted_norm").is_some();
    let per_sample = contracted || names.setting("rgbnet_direct").is_some();
    let channels = match (names.tensor("k0.grid"), names.tensor("k0.f_vec")) {
        (Some(grid), _) => grid.shape().get(1).copied(),
        (None, factors) => factors.and_then(|factors| factors.shape().get(1).copied()),
    };
    // Contracted scenes have no other network, and no flag.
    let is_whole = contracted && names.tensor("viewfreq").is_none_or(few);
    let has_grids = ["density.grid", "density"].iter().any(|name| names.tensor(name).is_some());
    if is_whole && has_grids && channels.is_some() {
        return true;
    }
    per_sample
        && channels.is_some_and(|channels| (4..=256).contains(&channels))
        && channels != Some(DEFERRED_CHANNELS)
        && names.tensor("rgbnet.0.weight").is_some()
        && names.tensor("viewfreq").is_some_and(few)
}

fn few(octaves: &Tensor) -> bool {
    octaves.count() <= OCTAVES
}

/// Opens a checkpoint. Without the network, it is opened like any other.
///
/// # Errors
/// Those of [`checkpoint::open_tensors`], and layers that do not follow each other.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if !options.drop_background
        && let Some(whole) = checkpoint::open_whole(file, options, limits)?
    {
        return open_unbounded::open(file, whole, options, limits);
    }
    if options.mlp != MlpChoice::Auto || options.view == ViewChoice::None {
        return checkpoint::open_tensors(file, options, limits);
    }
    let plain = SourceOptions { mlp: MlpChoice::None, view: ViewChoice::Keep, ..options.clone() };
    let mut source = checkpoint::open_tensors(file, &plain, limits)?;
    let names = NamedValues::new(file);
    let (density, color) =
        (StoredGrid::find(&names, "density", limits)?, StoredGrid::find(&names, "k0", limits)?);
    let network = network(&names, color.channels)?;
    let inner = Inner::find(&names, options)?;
    let harmonics = harmonics(options.view);
    source.assumptions.retain(|assumption| assumption.key != "mlp");
    source.assumptions.push(fit_assumption(harmonics.degree, false, &options.cameras));
    source.family = Family::Dvgo;
    let field = source.field.clone();
    let geometry = RadianceField { color: Vec::new(), ..field.clone() };
    let (features, cameras) = (color.clone().into_grid(), &options.cameras);
    let features = StoredFeatures::new(features, network.clone(), limits);
    let nodal = FittedColors::new(features, harmonics, geometry, cameras, limits);
    let colors = ProjectedColors::new(nodal);
    let model = Arc::new(DvgoFile { field, density, color, network, inner });
    source.field.color = vec![Grid::Values(Arc::new(colors))];
    source.field.color_domain = ColorDomain::Linear;
    source.field.view = Some(ViewDependence::Harmonics(harmonics));
    source.field.check()?;
    source.model = Some(model);
    Ok(source)
}
