//! The fit of one level, from its first step to its best state.

use super::adam::Adam;
use super::context::{End, FitContext, FittedLevel, psnr};
use super::gradient::{Gradient, Rays};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::grid::NodeMask;
use crate::view::render::View;
use crate::view::sample::Dense;

/// Parts of a batch of rays that are differentiated at once; fixed, so that sums are too.
const PARTS: usize = 8;
/// Rays of a step.
const BATCH: usize = 4096;
/// The number of the first validation ray: steps draw lower ones.
const FIRST_VALIDATION: usize = 1 << 40;
/// Validation rays.
const VALIDATION: usize = 8192;
/// Steps between two measurements.
const STEPS_BETWEEN: usize = 25;
/// Gain between two measurements, in dB, below which the fit has stalled.
const LEAST_GAIN: f64 = 0.005;
/// Measurements without gain, one after another, that end a fit.
const PATIENCE: usize = 2;

/// The fit of one level.
pub struct LevelFit<'a> {
    pub context: &'a FitContext<'a>,
    pub view: &'a View,
    pub level: usize,
    pub retained: &'a NodeMask,
}

impl LevelFit<'_> {
    /// Leaves the best state in `field`. Takes no steps where the caller had enough of an earlier
    /// level, whose `end` it takes over then.
    pub fn run<const C: usize>(
        &self,
        field: &mut Dense<C>,
        end: End,
    ) -> Result<(FittedLevel, End)> {
        let FitContext { options, progress, .. } = self.context;
        let steps = options.steps;
        let before = self.validation_psnr(field)?;
        let mut fitted =
            FittedLevel { level: self.level, steps: 0, psnr_before: before, psnr_after: before };
        let mut adam = Adam::new(field, self.level, self.retained, self.view.color_domain);
        let mut gradients: Vec<Gradient<C>> =
            (0..PARTS).map(|_| Gradient::new(adam.nodes())).collect();
        let mut best = adam.state(field);
        let first = self.spent();
        let mut stalled = 0;
        let mut end = match end {
            End::Enough => End::Enough,
            // Where the measurement took all of its share, a level still has one step.
            _ if options.seconds.is_some_and(|seconds| first >= seconds) => End::OutOfTime,
            _ => End::Reached,
        };
        while fitted.steps < steps && end == End::Reached && stalled < PATIENCE {
            self.tell(&fitted);
            let share = self.allowed() - first;
            let by_seconds = if share > 0.0 { (self.spent() - first) / share } else { 1.0 };
            let by_steps = fitted.steps as f64 / steps as f64;
            let rays = self.rays(field, adam.numbers());
            parallel::map_mut(&mut gradients, |part, gradient| {
                for i in 0..BATCH / PARTS {
                    if progress.cancelled() {
                        return Err(Error::cancelled());
                    }
                    let number = (fitted.steps * PARTS + part) * (BATCH / PARTS) + i;
                    rays.differentiate(number, gradient);
                }
                Ok(())
            })?;
            adam.step(field, &mut gradients, by_steps.max(by_seconds) as f32)?;
            fitted.steps += 1;
            progress.advance(Step::Fit, 1);
            end = match () {
                () if progress.enough() => End::Enough,
                () if self.spent() >= self.allowed() => End::OutOfTime,
                () => End::Reached,
            };
            let is_last = fitted.steps == steps || end != End::Reached;
            if fitted.steps.is_multiple_of(STEPS_BETWEEN) || is_last {
                let now = self.validation_psnr(field)?;
                stalled = if now < fitted.psnr_after + LEAST_GAIN { stalled + 1 } else { 0 };
                if now > fitted.psnr_after {
                    fitted.psnr_after = now;
                    best = adam.state(field);
                }
            }
        }
        // Steps that were not taken count as done.
        progress.advance(Step::Fit, (steps - fitted.steps) as u64);
        adam.restore(field, &best);
        Ok((fitted, end))
    }

    /// Names the level, the step and the quality so far.
    fn tell(&self, fitted: &FittedLevel) {
        let FitContext { options, progress, retained, .. } = self.context;
        let (level, levels) = (self.level, retained.len() - 1);
        let (step, psnr) = (fitted.steps + 1, fitted.psnr_after);
        let steps = options.steps;
        let part = format!("level {level} of {levels}, step {step}/{steps}, {psnr:.1} dB");
        progress.part(Step::Fit, &part);
    }

    /// Seconds since the fit's start.
    fn spent(&self) -> f64 {
        self.context.clock.elapsed().as_secs_f64()
    }

    /// Seconds since the fit's start that may be spent by this level's end.
    fn allowed(&self) -> f64 {
        let FitContext { options, retained, before, .. } = self.context;
        let share = self.level as f64 / (retained.len() - 1) as f64;
        options.seconds.map_or(f64::INFINITY, |seconds| before + (seconds - before) * share)
    }

    fn validation_psnr<const C: usize>(&self, field: &Dense<C>) -> Result<f64> {
        let rays = self.rays(field, &[]);
        Ok(psnr(mean_square(&rays, VALIDATION, self.context.progress)?))
    }

    /// Rays through level 0 to the one that is fitted: coarser ones are not fitted yet.
    fn rays<'b, const C: usize>(&'b self, field: &'b Dense<C>, numbers: &'b [u32]) -> Rays<'b, C> {
        let (view, targets, level) = (self.view, self.context.targets, self.level);
        Rays { view, field, levels: level + 1, level, targets, numbers }
    }
}

/// Mean squared error of the colours of `count` validation rays, a multiple of 8.
pub fn mean_square<const C: usize>(
    rays: &Rays<C>,
    count: usize,
    progress: &dyn Progress,
) -> Result<f64> {
    let sums = parallel::map(PARTS, |part| {
        let share = count / PARTS;
        let first = FIRST_VALIDATION + part * share;
        let mut gradient = Gradient::new(0);
        let mut sum = 0.0;
        for number in first..first + share {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            sum += f64::from(rays.square(number, &mut gradient));
        }
        Ok(sum)
    })?;
    Ok(sums.iter().sum::<f64>() / (3 * count) as f64)
}
