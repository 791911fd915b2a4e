//! The fit of all levels, from a trained field to values.

use std::time::Instant;

use super::context::{FitContext, FitOptions, FittedLevel};
use super::joint_fit::JointFit;
use super::target::Targets;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::model::baked::LevelOfDetail;
use crate::model::field::RadianceField;
use crate::model::grid::NodeMask;
use crate::view::render::{Renderer, TrainedLevels, View, with_lanes};
use crate::view::sample::{Dense, Stored};

/// Fitted levels.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// From level 1 on, `[channel][node]`, density first.
    values: Vec<Vec<Vec<f32>>>,
    /// The rule under which the levels look best.
    pub level_of_detail: LevelOfDetail,
    /// The fit of each level, from level 1 on.
    pub levels: Vec<FittedLevel>,
    /// True if the fit stopped at its time limit or at the wish of the caller.
    pub cut_short: bool,
}

impl Fitted {
    /// The coarser levels of `field` as they are.
    pub(super) fn new<const C: usize>(
        view: &View,
        field: &Dense<C>,
        level_of_detail: LevelOfDetail,
        levels: Vec<FittedLevel>,
        cut_short: bool,
    ) -> Self {
        let values = (1..=levels.len()).map(|level| channels(view, field, level)).collect();
        Self { values, level_of_detail, levels, cut_short }
    }

    /// Puts fitted values in the place of plane `x` of a channel of `level`.
    pub fn replace(&self, level: usize, x: usize, channel: usize, plane: &mut [f32]) {
        if let Some(fitted) = level.checked_sub(1).and_then(|level| self.values.get(level)) {
            plane.copy_from_slice(&fitted[channel][x * plane.len()..][..plane.len()]);
        }
    }
}

/// Fits the coarser `levels` of `field`. Only nodes in `retained`, one set for each level, change.
/// `masked` says whether renderers will have the free-space mask.
///
/// # Errors
/// `Malformed` for a field or cameras that cannot be rendered, `OverLimit` where the pictures do
/// not fit in the memory of `limits`, `Cancelled`.
pub fn fit(
    field: &RadianceField,
    levels: TrainedLevels,
    retained: &[&NodeMask],
    masked: bool,
    options: &FitOptions,
    limits: &Limits,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let clock = Instant::now();
    let mut rendered = Renderer::trained(field, Some(levels), limits)?;
    if !masked {
        rendered.view_mut().free_space = None;
    }
    let coarser = retained.len().saturating_sub(1);
    let targets = Targets::new(&rendered, coarser, options.cameras, limits, progress)?;
    progress.begin(Step::Fit, options.steps as u64);
    let start = levels.level_of_detail;
    let context = FitContext { targets: &targets, retained, options, start, clock, progress };
    let (view, values) = rendered.into_parts()?;
    with_lanes!(values, stored => context.fit(view, stored))
}

impl FitContext<'_> {
    fn fit<const C: usize>(&self, view: View, stored: Stored<C>) -> Result<Fitted> {
        match stored {
            Stored::Dense(field) if self.retained.len() > 1 && self.targets.scales > 0 => {
                JointFit::new(self, view, field).run()
            }
            // Trained fields are dense.
            _ => Ok(Fitted {
                values: Vec::new(),
                level_of_detail: self.start,
                levels: Vec::new(),
                cut_short: false,
            }),
        }
    }
}

/// A level's values by channel, density first.
fn channels<const C: usize>(view: &View, field: &Dense<C>, level: usize) -> Vec<Vec<f32>> {
    let (density, color) = field.values(level);
    let lane = |lane: usize| color.iter().map(|color| color[lane]).collect();
    [density.to_vec()].into_iter().chain((0..3 + view.features).map(lane)).collect()
}
