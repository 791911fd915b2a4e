//! The first step of a bake and of its forecast: the visible nodes of each level.

use super::BakeOptions;
use super::importance::LevelImportance;
use super::report::Stages;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::levels::{Light, Visible, visible};
use crate::model::field::{Planes, RadianceField};
use crate::model::grid::Nodes;
use crate::view::render::{CameraCoverage, Renderer, camera_coverage};

/// A field whose visible nodes are known.
#[derive(Debug)]
pub struct Prepared<'a> {
    /// The field's planes.
    pub planes: Planes<'a>,
    /// Sizes of the levels, finest first.
    pub sizes: Vec<Nodes>,
    /// The visible nodes.
    pub visible: Visible,
    /// The importance of each level's nodes; empty if all count alike.
    pub importance: Vec<LevelImportance>,
}

impl<'a> Prepared<'a> {
    /// Reads density, and follows the rays of cameras where `options` depend on them.
    ///
    /// # Errors
    ///
    /// Errors of reading; values that are not finite, if these are refused; cameras that see
    /// nothing of a field that is not empty.
    pub fn new(
        field: &'a RadianceField,
        options: &BakeOptions,
        stages: &mut Stages,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Self::find(field, options, false, stages, progress)
    }

    /// The same for a box of a world, where light also comes from empty space.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn lit_inside(
        field: &'a RadianceField,
        options: &BakeOptions,
        stages: &mut Stages,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Self::find(field, options, true, stages, progress)
    }

    fn find(
        field: &'a RadianceField,
        options: &BakeOptions,
        lit_inside: bool,
        stages: &mut Stages,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let filter = &*options.filter;
        let mut sizes = filter.level_sizes(field.scene.nodes, options.levels);
        if lit_inside && sizes.len() == 1 {
            // The next larger box is made of a coarser level, however small this one is.
            sizes.push(field.scene.nodes.halved());
        }
        let planes = visible::masked_planes(field, options.nonfinite, progress)?;
        let light = Light { importance: options.is_seen_nearby(), from_inside: lit_inside };
        let mut visible =
            Visible::find(&planes, &sizes, filter, options.alpha_threshold, light, progress)?;
        stages.end("prune", visible.bytes_read);
        let mut importance = Vec::new();
        if options.sees() {
            let unbaked = Renderer::trained(field, None, &options.limits)?;
            let least = options.min_weight.unwrap_or(1.0);
            let coverage = camera_coverage(&unbaked, &options.seen_from, least, progress)?;
            if visible.levels[0].retained.count() > 0 {
                require_sight(&coverage, options)?;
            }
            if options.min_weight.is_some() {
                visible.keep_cells(&coverage.cells)?;
            }
            stages.end("expose", 0);
            importance = LevelImportance::of_cameras(coverage, &sizes, options);
        }
        let measured = visible.visibility.as_mut();
        if let Some(nearby) = measured.and_then(|visibility| visibility.importance.take()) {
            importance = LevelImportance::of_nearby(nearby, &sizes);
        }
        Ok(Self { planes, sizes, visible, importance })
    }
}

/// Refuses cameras and weights that would drop the whole field: they were meant for another one.
fn require_sight(coverage: &CameraCoverage, options: &BakeOptions) -> Result<()> {
    if coverage.importance.iter().all(|&importance| importance == 0.0) {
        let found = match options.seen_from.len() {
            0 => "no cameras".to_owned(),
            count => format!("{count} cameras, none of which sees anything"),
        };
        return Err(Error::invalid_option("seen_from", found, "cameras that see the scene"));
    }
    let weight = options.min_weight.unwrap_or(0.0);
    let is_left = options.min_weight.is_none() || coverage.cells.count() > 0;
    Error::require_option(is_left, "min_weight", weight, "less: no sample has so much weight")
}
