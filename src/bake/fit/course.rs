//! The fit of one level, from its first step to its best state.

use super::adam::Adam;
use super::context::{FitContext, FittedLevel, psnr};
use super::gradient::{Gradient, Rays};
use crate::base::error::Result;
use crate::base::parallel;
use crate::base::progress::Step;
use crate::model::grid::NodeMask;
use crate::view::render::View;
use crate::view::sample::Dense;

/// Parts of a batch of rays that are differentiated at once; fixed, so that sums are too.
const PARTS: usize = 8;
/// Rays of a step.
const BATCH: usize = 4096;
/// Numbers of the rays that are watched start here, beyond all that steps draw.
const FIRST_WATCHED: usize = 1 << 40;
/// Rays that are watched.
const WATCHED: usize = 8192;
/// Steps from one look at them to the next.
const STRIDE: usize = 25;
/// Gain, in dB, without which a stretch of steps was in vain.
const LEAST_GAIN: f64 = 0.005;
/// Stretches in vain, one after another, that end a fit.
const PATIENCE: usize = 2;

/// One level's fit.
pub struct Course<'a> {
    pub work: &'a FitContext<'a>,
    pub view: &'a View,
    pub level: usize,
    pub needed: &'a NodeMask,
}

impl Course<'_> {
    /// Leaves the best state in `field`; also says whether it was cut short. Takes no steps where an
    /// earlier level was `cut`.
    pub fn run<const C: usize>(
        &self,
        field: &mut Dense<C>,
        cut: bool,
    ) -> Result<(FittedLevel, bool)> {
        let FitContext { options, progress, .. } = self.work;
        let steps = options.steps;
        let before = self.watched_psnr(field)?;
        let mut fitted =
            FittedLevel { level: self.level, steps: 0, psnr_before: before, psnr_after: before };
        let mut adam = Adam::new(field, self.level, self.needed);
        let mut gradients: Vec<Gradient<C>> =
            (0..PARTS).map(|_| Gradient::new(adam.nodes())).collect();
        let mut best = adam.state(field);
        let (mut cut, mut in_vain) = (cut, 0);
        while fitted.steps < steps && !cut && in_vain < PATIENCE {
            let (spent, allowed) = self.seconds();
            let by_seconds = if allowed > 0.0 { spent / allowed } else { 1.0 };
            let by_steps = fitted.steps as f64 / steps as f64;
            let rays = self.rays(field, adam.numbers());
            parallel::map_mut(&mut gradients, |part, gradient| {
                for i in 0..BATCH / PARTS {
                    let number = (fitted.steps * PARTS + part) * (BATCH / PARTS) + i;
                    rays.differentiate(number, gradient);
                }
                Ok(())
            })?;
            adam.step(field, &mut gradients, by_steps.max(by_seconds) as f32)?;
            fitted.steps += 1;
            progress.advance(Step::Fit, 1);
            let (spent, allowed) = self.seconds();
            cut = progress.enough() || spent >= allowed;
            if fitted.steps.is_multiple_of(STRIDE) || fitted.steps == steps || cut {
                let now = self.watched_psnr(field)?;
                progress.quality(Step::Fit, now);
                in_vain = if now < fitted.psnr_after + LEAST_GAIN { in_vain + 1 } else { 0 };
                if now > fitted.psnr_after {
                    fitted.psnr_after = now;
                    best = adam.state(field);
                }
            }
        }
        // What is not done counts as done.
        progress.advance(Step::Fit, (steps - fitted.steps) as u64);
        adam.restore(field, &best);
        Ok((fitted, cut))
    }

    /// Seconds since the fit's start, and those that are allowed by this level's end: levels share what
    /// there is evenly.
    fn seconds(&self) -> (f64, f64) {
        let levels = self.work.needed.len() - 1;
        let share = self.level as f64 / levels as f64;
        let allowed = self.work.options.seconds.map_or(f64::INFINITY, |seconds| seconds * share);
        (self.work.clock.elapsed().as_secs_f64(), allowed)
    }

    fn watched_psnr<const C: usize>(&self, field: &Dense<C>) -> Result<f64> {
        Ok(psnr(mean_square(&self.rays(field, &[]), WATCHED)?))
    }

    /// Coarser levels are not there yet.
    fn rays<'b, const C: usize>(&'b self, field: &'b Dense<C>, numbers: &'b [u32]) -> Rays<'b, C> {
        let (view, targets, level) = (self.view, self.work.targets, self.level);
        Rays { view, field, levels: level + 1, level, targets, numbers }
    }
}

/// Mean squared error of colours of `count` of the rays that no step uses, a multiple of 8.
pub fn mean_square<const C: usize>(rays: &Rays<C>, count: usize) -> Result<f64> {
    let sums = parallel::map(PARTS, |part| {
        let share = count / PARTS;
        let first = FIRST_WATCHED + part * share;
        let mut gradient = Gradient::new(0);
        Ok((first..first + share)
            .map(|number| f64::from(rays.square(number, &mut gradient)))
            .sum::<f64>())
    })?;
    Ok(sums.iter().sum::<f64>() / (3 * count) as f64)
}
