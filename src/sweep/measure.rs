//! Bakes one setting, times it, and compares it with the unbaked input.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::options::SweepOptions;
use super::record;
use super::report::Measured;
use super::setting::Setting;
use super::thumbnail::Thumbnail;
use crate::bake::{Origin, bake};
use crate::base::bytes::{Output, SourceFile};
use crate::base::error::{Error, Result};
use crate::base::progress::{Progress, Step};
use crate::container::Container;
use crate::view::compare::References;
use crate::view::render::Renderer;
use mipvog_inputs::Source;

/// The common inputs of all measurements.
pub(super) struct Bench<'a> {
    pub(super) source: &'a Source,
    pub(super) origin: Origin,
    pub(super) options: &'a SweepOptions,
    pub(super) folder: &'a Path,
    pub(super) references: References<'a>,
    pub(super) steps: Steps<'a>,
    /// Units of the sweep in one bake.
    pub(super) bake_work: u64,
}

impl Bench<'_> {
    /// The figures of a setting, and a small picture of it.
    pub(super) fn measure(&mut self, setting: &Setting) -> Result<(Measured, Option<Thumbnail>)> {
        let path = record::container_path(self.folder, setting);
        let mut seconds = Vec::with_capacity(self.options.repeat);
        let mut last = None;
        let mut options = setting.options.clone();
        options.limits = self.options.limits.clone();
        for _ in 0..self.options.repeat {
            let mut output = Output::create(&path, true)?;
            let clock = Instant::now();
            let field = &self.source.field;
            let report =
                bake(field, &options, &self.origin, &mut output, &Baking(self.steps.outer))
                    .map_err(|error| error.in_file(self.source.file.path()))?;
            seconds.push(clock.elapsed().as_secs_f64());
            last = Some((output, report));
            self.steps.advance(Step::Sweep, self.bake_work);
        }
        let Some((output, report)) = last else {
            return Err(Error::invalid_option("repeat", "0", "at least 1"));
        };
        output.finish()?;
        let container = Container::open(Arc::new(SourceFile::open(&path)?), &self.options.limits)?;
        let field = Renderer::baked(&container.read()?, &self.options.limits)?;
        let mut thumbnail = None;
        let first = self.options.scales.iter().min().copied();
        let errors = self.references.compare(&field, &self.steps, |frame| {
            if thumbnail.is_none() && Some(frame.scale) == first {
                thumbnail = Some(Thumbnail::of(frame)?);
            }
            Ok(())
        })?;
        let levels = report.levels.len();
        let output_bytes = report.output_bytes;
        Ok((Measured { output_bytes, seconds: median(seconds), levels, errors }, thumbnail))
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = (values.len().saturating_sub(1) / 2, values.len() / 2);
    let at = |i: usize| values.get(i).copied().unwrap_or_default();
    0.5 * (at(low) + at(high))
}

/// Forwards requests to stop, but not the bake's own steps.
pub(super) struct Baking<'a>(pub(super) &'a dyn Progress);

impl Progress for Baking<'_> {
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// Reports the bakes and renders of a setting as steps of the sweep.
pub(super) struct Steps<'a> {
    pub(super) outer: &'a dyn Progress,
    pub(super) done: AtomicU64,
}

impl Steps<'_> {
    /// Advances over skipped steps.
    pub(super) fn reach(&self, target: u64) {
        let left = target.saturating_sub(self.done.load(Ordering::Relaxed));
        self.advance(Step::Sweep, left);
    }
}

impl Progress for Steps<'_> {
    fn advance(&self, step: Step, by: u64) {
        if matches!(step, Step::Render | Step::Sweep) {
            self.done.fetch_add(by, Ordering::Relaxed);
            self.outer.advance(Step::Sweep, by);
        }
    }

    fn cancelled(&self) -> bool {
        self.outer.cancelled()
    }
}
