//! The fit of all levels, from a trained field to values.

use std::time::Instant;

use super::context::{FitContext, Fitted};
use super::joint_fit::JointFit;
use super::options::FitOptions;
use super::target::Targets;
use crate::base::error::{ErrorKind, Result};
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::model::baked::LevelOfDetail;
use crate::model::field::RadianceField;
use crate::model::grid::NodeMask;
use crate::view::render::{Renderer, TrainedLevels, View, with_lanes};
use crate::view::sample::Stored;

/// Fits the coarser `levels` of `field`. Only nodes in `retained`, one set for each level, change.
/// `masked` is true if renderers will have the free-space mask.
///
/// # Errors
/// `Malformed` for a field or cameras that cannot be rendered, `OverLimit` if the pictures do
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
    let start = levels.level_of_detail;
    let rendered = |levels| {
        let mut rendered = Renderer::trained(field, levels, limits)?;
        if !masked {
            rendered.view_mut().free_space = None;
        }
        Ok(rendered)
    };
    let coarser = retained.len().saturating_sub(1);
    let deadline = Deadline { clock, seconds: options.seconds, progress };
    // Level 0 alone has fewer lanes, so its pictures are rendered faster.
    let targets = match Targets::new(&rendered(None)?, coarser, options, limits, &deadline) {
        Ok(targets) => targets,
        Err(error) if matches!(error.kind(), ErrorKind::Cancelled) && !progress.cancelled() => {
            let (view, values) = rendered(Some(levels))?.into_parts()?;
            return Ok(
                with_lanes!(values, stored => unfitted(&view, &stored, retained.len(), start)),
            );
        }
        Err(error) => return Err(error),
    };
    progress.begin(Step::Fit, options.steps as u64);
    let context = FitContext { targets: &targets, retained, options, start, clock, progress };
    let (view, values) = rendered(Some(levels))?.into_parts()?;
    with_lanes!(values, stored => context.fit(view, stored))
}

/// Also requests a stop when the time limit of a fit has passed.
struct Deadline<'a> {
    clock: Instant,
    seconds: Option<f64>,
    progress: &'a dyn Progress,
}

impl Progress for Deadline<'_> {
    fn begin(&self, step: Step, total: u64) {
        self.progress.begin(step, total);
    }

    fn advance(&self, step: Step, by: u64) {
        self.progress.advance(step, by);
    }

    fn part(&self, step: Step, name: &str) {
        self.progress.part(step, name);
    }

    fn enough(&self) -> bool {
        self.progress.enough()
    }

    fn cancelled(&self) -> bool {
        let is_over = |seconds| self.clock.elapsed().as_secs_f64() >= seconds;
        self.seconds.is_some_and(is_over) || self.progress.cancelled()
    }
}

/// The filter's levels, if there was no time for a step.
fn unfitted<const C: usize>(
    view: &View,
    stored: &Stored<C>,
    levels: usize,
    start: LevelOfDetail,
) -> Fitted {
    match stored {
        Stored::Dense(field) => Fitted::unfitted(view, field, levels),
        // Trained fields are dense.
        _ => Fitted::none(start),
    }
}

impl FitContext<'_> {
    fn fit<const C: usize>(&self, view: View, stored: Stored<C>) -> Result<Fitted> {
        match stored {
            Stored::Dense(field) if self.retained.len() > 1 && self.targets.scales > 0 => {
                JointFit::new(self, view, field).run()
            }
            // Trained fields are dense.
            _ => Ok(Fitted::none(self.start)),
        }
    }
}
