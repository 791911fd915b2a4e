//! The fit of all levels at once, from its first step to its best state.

use super::adam::{Adam, State, StepLength};
use super::context::{FitContext, Fitted, FittedLevel};
use super::curve::{ByKnots, Curve};
use super::finest::Finest;
use super::gradient::Gradient;
use super::quality::ScaleQuality;
use super::target::Windows;
use super::trace::Rays;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::Step;
use crate::levels::{Filter, SharedFilter};
use crate::model::baked::LevelOfDetail;
use crate::view::render::View;
use crate::view::sample::Dense;

/// Number of parts of a batch that are differentiated in parallel; fixed, so that sums are
/// reproducible.
const PARTS: usize = 8;
/// Rays of a step, over all scales.
const BATCH: usize = 13312;
/// Each scale has this share of the rays of the next finer one, and at least [`LEAST_RAYS`].
const THINNING: f64 = 0.8;
/// Rays of a scale in a step, at least.
const LEAST_RAYS: usize = 512;
/// Steps between two measurements.
const STEPS_BETWEEN: usize = 25;
/// Gain of the mean over scales between two measurements, in dB, below which the fit has stalled.
const LEAST_GAIN: f64 = 0.005;
/// Number of consecutive measurements without gain after which a fit shortens its schedule.
const PATIENCE: usize = 3;
/// Steps use one of this many samples of their rays. With all samples PSNR is higher by 0.03 dB,
/// and a fit takes 1.15 times as long.
const EVERY: u32 = 2;
/// Fraction of the steps before the curve moves: unfitted levels would pull it to finer levels.
const FIRST_MOVE: f32 = 0.2;

/// All levels' fit.
pub struct JointFit<'a, const C: usize> {
    context: &'a FitContext<'a>,
    view: View,
    /// Without the colours of level 0.
    field: Dense<C>,
    finest: Finest<C>,
    curve: Curve,
    /// From level 1 on.
    adams: Vec<Adam<C>>,
}

/// Values of all fitted levels.
type States<const C: usize> = Vec<State<C>>;

/// A state of the fit.
struct Reached<const C: usize> {
    states: States<C>,
    rule: LevelOfDetail,
    curve: Curve,
    quality: ScaleQuality,
}

impl<'a, const C: usize> JointFit<'a, C> {
    /// From the filter's levels in `field`.
    pub fn new(context: &'a FitContext<'a>, view: View, mut field: Dense<C>) -> Self {
        let retained = context.retained.iter().enumerate().skip(1);
        let adams: Vec<_> =
            retained.map(|(level, nodes)| Adam::new(&mut field, level, nodes, &view)).collect();
        let curve = Curve::above(context.start, adams.len());
        let finest = Finest::taken_from(&mut field);
        Self { context, view, field, finest, curve, adams }
    }

    /// Fits, and keeps the state that is best at every scale.
    pub fn run(mut self) -> Result<Fitted> {
        let FitContext { options, progress, .. } = self.context;
        let rule = SharedFilter::from(Filter::RateTent).rule();
        let before = self.spent();
        let quality = self.quality_of(rule)?;
        let measurement = self.spent() - before;
        let unfitted = Reached { rule, ..self.reached(quality) };
        let quality = self.quality_of(self.curve.rule())?;
        let mut best = self.reached(quality);
        let nodes: Vec<usize> = self.adams.iter().map(Adam::nodes).collect();
        let mut gradients: Vec<Gradient<C>> = (0..PARTS).map(|_| Gradient::new(&nodes)).collect();
        let (mut taken, mut stalled) = (0, 0);
        // Position in the schedule of step lengths: ahead of the steps taken once the schedule is
        // shortened.
        let (mut passed, mut pace) = (0, 1);
        // Time reserved after the last step for measuring the result and the candidates.
        let seconds = options.seconds.unwrap_or(f64::INFINITY)
            - measurement * self.most_measurements(&unfitted) as f64;
        let first = self.spent();
        let mut cut_short = first >= seconds;
        while passed < options.steps && !cut_short {
            self.tell(taken, &best);
            let by_seconds = (self.spent() - first) / (seconds - first);
            let done = by_seconds.max(passed as f64 / options.steps as f64);
            self.step(&mut gradients, taken, done as f32, &best.quality.psnr)?;
            (taken, passed) = (taken + 1, passed + pace);
            progress.advance(Step::Fit, 1);
            cut_short = progress.enough() || self.spent() >= seconds;
            if taken.is_multiple_of(STEPS_BETWEEN) || passed >= options.steps || cut_short {
                let quality = self.quality_of(self.curve.rule())?;
                let gain = quality.mean() - best.quality.mean();
                stalled = if gain < LEAST_GAIN { stalled + 1 } else { 0 };
                if gain > 0.0 {
                    best = self.reached(quality);
                }
                if stalled == PATIENCE {
                    // The fit does not end here: long steps hide the gain of shorter ones.
                    (stalled, pace) = (0, 2 * pace);
                }
            }
        }
        // Steps that were not taken count as done.
        progress.advance(Step::Fit, (options.steps - taken) as u64);
        let kept = match taken {
            0 => self.keep_unfitted(&unfitted, &mut best),
            _ => self.keep_best(&unfitted, &mut best)?,
        };
        let at = |psnr: &[f64], level: usize| psnr[(level - 1).min(psnr.len() - 1)];
        let report = |level: usize| FittedLevel {
            level,
            steps: taken,
            psnr_before: Some(at(&unfitted.quality.psnr, level)),
            psnr_after: Some(at(&best.quality.psnr, level)),
            kept: kept[level - 1],
        };
        let levels = (1..=self.adams.len()).map(report).collect();
        Ok(Fitted::new(&self.view, &self.field, best.rule, levels, cut_short))
    }

    /// Measurements from the end of the steps on, at most.
    fn most_measurements(&self, unfitted: &Reached<C>) -> usize {
        let levels = self.adams.len();
        1 + levels + levels.saturating_sub(1) * self.curve.far_rules(unfitted.rule).len()
    }

    /// Leaves the filter's levels in the field.
    fn keep_unfitted(&mut self, unfitted: &Reached<C>, best: &mut Reached<C>) -> Vec<bool> {
        self.restore(&unfitted.states);
        (best.rule, best.quality) = (unfitted.rule, unfitted.quality.clone());
        vec![false; self.adams.len()]
    }

    /// Leaves the levels with the highest mean PSNR in the field, among candidates that are at no
    /// scale worse than the filter's. Candidates are all fitted levels; all but one; those from a
    /// level on, with the filter's rule up to a knot, so that near pictures do not change; none.
    /// Returns which are fitted.
    fn keep_best(&mut self, unfitted: &Reached<C>, best: &mut Reached<C>) -> Result<Vec<bool>> {
        let levels = self.adams.len();
        let fits = |quality: &ScaleQuality| quality.is_nowhere_below(&unfitted.quality);
        self.restore(&best.states);
        if fits(&best.quality) {
            return Ok(vec![true; levels]);
        }
        let which = |kept: &dyn Fn(usize) -> bool| (0..levels).map(kept).collect::<Vec<_>>();
        let without_one = (0..levels).map(|level| (which(&|kept| kept != level), best.rule));
        let far_rules = best.curve.far_rules(unfitted.rule);
        let far = (1..levels).flat_map(|first| {
            far_rules.iter().map(move |&rule| (which(&|level| level >= first), rule))
        });
        let (mut rule_kept, mut quality_kept) = (unfitted.rule, unfitted.quality.clone());
        let mut fitted = which(&|_| false);
        for (kept, rule) in without_one.chain(far) {
            self.restore_each(&kept, best, unfitted);
            let quality = self.quality_of(rule)?;
            if fits(&quality) && quality.mean() > quality_kept.mean() {
                (rule_kept, quality_kept, fitted) = (rule, quality, kept);
            }
        }
        self.restore_each(&fitted, best, unfitted);
        (best.rule, best.quality) = (rule_kept, quality_kept);
        Ok(fitted)
    }

    /// Restores each level as it was fitted, or as the filter made it.
    fn restore_each(&mut self, fitted: &[bool], best: &Reached<C>, unfitted: &Reached<C>) {
        for (level, &fitted) in fitted.iter().enumerate() {
            let from = if fitted { best } else { unfitted };
            self.adams[level].restore(&mut self.field, &from.states[level]);
        }
    }

    fn states(&self) -> States<C> {
        self.adams.iter().map(|adam| adam.state(&self.field)).collect()
    }

    /// The state now, which has this quality.
    fn reached(&self, quality: ScaleQuality) -> Reached<C> {
        let (rule, curve) = (self.curve.rule(), self.curve.clone());
        Reached { states: self.states(), rule, curve, quality }
    }

    fn restore(&mut self, states: &States<C>) {
        for (adam, state) in self.adams.iter().zip(states) {
            adam.restore(&mut self.field, state);
        }
    }

    /// One step of all levels. Squared errors are divided by their scale's mean, so that a decibel
    /// counts the same at every scale.
    fn step(
        &mut self,
        gradients: &mut [Gradient<C>],
        taken: usize,
        done: f32,
        psnr: &[f64],
    ) -> Result<()> {
        self.view.level_of_detail = Some(self.curve.rule());
        let scales = self.context.targets.scales;
        let whole: f64 = (0..scales).map(|scale| THINNING.powi(scale as i32)).sum();
        let numbers: Vec<&[u32]> = self.adams.iter().map(Adam::numbers).collect();
        let rays = Rays { every: EVERY, ..self.rays(&numbers) };
        parallel::map_mut(gradients, |part, gradient| {
            for (scale, psnr) in psnr.iter().enumerate() {
                let share = BATCH as f64 * THINNING.powi(scale as i32) / whole;
                let count = (share as usize).max(LEAST_RAYS) / PARTS;
                let worth = libm::exp10(0.1 * psnr) / (share * 1e3);
                for i in 0..count {
                    if self.context.progress.cancelled() {
                        return Err(Error::cancelled());
                    }
                    let number = (taken * PARTS + part) * count + i;
                    let windows = Windows::Part(part * count + i, PARTS * count);
                    rays.differentiate(scale, number, windows, worth as f32, gradient);
                }
            }
            Ok(())
        })?;
        let length = StepLength::of(self.context.options.steps, done);
        for (index, adam) in self.adams.iter_mut().enumerate() {
            adam.step(&mut self.field, gradients, index, length)?;
        }
        let mut by = ByKnots::default();
        for gradient in gradients {
            let part = std::mem::take(&mut gradient.knots);
            by.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        if done >= FIRST_MOVE {
            self.curve.step(&by, done);
        }
        Ok(())
    }

    /// Names the step and the quality so far.
    fn tell(&self, taken: usize, best: &Reached<C>) {
        let (step, steps, psnr) = (taken + 1, self.context.options.steps, best.quality.mean());
        let part = format!("all levels, step {step}/{steps}, {psnr:.1} dB");
        self.context.progress.part(Step::Fit, &part);
    }

    /// Seconds since the fit's start.
    fn spent(&self) -> f64 {
        self.context.clock.elapsed().as_secs_f64()
    }

    fn rays<'b>(&'b self, numbers: &'b [&'b [u32]]) -> Rays<'b, C> {
        let Self { context, view, field, finest, curve, .. } = self;
        Rays { view, field, finest, targets: context.targets, numbers, curve, every: 1 }
    }

    /// The quality under a rule.
    fn quality_of(&mut self, rule: LevelOfDetail) -> Result<ScaleQuality> {
        self.view.level_of_detail = Some(rule);
        ScaleQuality::of(&self.rays(&[]), self.context.progress)
    }
}
