//! A folder as a field, and as a model with its own rules.

use std::sync::Arc;

use super::deferred::assumption;
use super::nodes::{ColorValues, DensityValues, FieldNodes};
use super::viewer::{FolderModel, Viewed};
use crate::base::error::Result;
use crate::model::field::{ColorDomain, Grid, RadianceField, Scene};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;
use crate::snerg::layout::FEATURES;
use crate::source::{Family, SideFile, Source};
use crate::tensor::TensorFile;

/// The contents of a folder.
pub struct Found<A> {
    pub family: Family,
    pub scene: Scene,
    pub assets: Arc<A>,
    /// The network, unless dropped.
    pub network: Option<ViewMlp>,
    pub side_files: Vec<SideFile>,
}

/// The input from a folder.
///
/// # Errors
/// Inconsistent parts of the field.
pub fn source<A>(file: &TensorFile, found: Found<A>) -> Result<Source>
where
    A: FieldNodes + Viewed + 'static,
{
    let Found { family, scene, assets, network, side_files } = found;
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
        assumptions: network.iter().map(|_| assumption(family.name())).collect(),
        model: Some(Arc::new(FolderModel { assets, network })),
        family,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        scene_scale: 1.0,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    })
}
