//! The fits of all levels, finest first.

use std::time::Instant;

use super::context::{End, FitContext, FitOptions, FittedLevel};
use super::level_fit::LevelFit;
use super::rule;
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
    progress.begin(Step::Fit, (coarser * options.steps) as u64);
    let start = levels.level_of_detail;
    let before = clock.elapsed().as_secs_f64();
    let context =
        FitContext { targets: &targets, retained, options, start, clock, before, progress };
    let (view, values) = rendered.into_parts()?;
    with_lanes!(values, stored => context.fit(view, stored))
}

impl FitContext<'_> {
    fn fit<const C: usize>(&self, mut view: View, stored: Stored<C>) -> Result<Fitted> {
        let mut fitted = Fitted {
            values: Vec::new(),
            level_of_detail: self.start,
            levels: Vec::new(),
            cut_short: false,
        };
        // Trained fields are dense.
        let Stored::Dense(mut field) = stored else { return Ok(fitted) };
        let mut end = End::Reached;
        for (level, retained) in self.retained.iter().enumerate().skip(1) {
            let fit = LevelFit { context: self, view: &view, level, retained };
            let level;
            (level, end) = fit.run(&mut field, end)?;
            fitted.levels.push(level);
            fitted.cut_short |= end != End::Reached;
        }
        let coarser = fitted.levels.len();
        if coarser > 0 {
            fitted.level_of_detail = rule::search(&mut view, self, &field, coarser)?;
        }
        fitted.values = (1..=coarser).map(|level| channels(&view, &field, level)).collect();
        Ok(fitted)
    }
}

/// A level's values by channel, density first.
fn channels<const C: usize>(view: &View, field: &Dense<C>, level: usize) -> Vec<Vec<f32>> {
    let (density, color) = field.values(level);
    let lane = |lane: usize| color.iter().map(|color| color[lane]).collect();
    [density.to_vec()].into_iter().chain((0..3 + view.features).map(lane)).collect()
}
