//! Shares of one progress bar for the steps of a verb, by expected time.

use crate::bake::BakeOptions;
use crate::base::progress::Step;
use crate::model::camera::Camera;
use crate::model::grid::Nodes;

/// Seconds of a step per node of level 0, on two threads. Only their ratios matter.
const PRUNE: f64 = 6e-8;
const RANGES: f64 = 6e-8;
const ENCODE: f64 = 1.5e-7;
const WRITE: f64 = 1e-8;
/// Seconds for a pixel of a rendered picture.
const PIXEL: f64 = 3e-6;
/// Seconds of a fit for each node, and of its reference pictures for each node.
const FIT: f64 = 8e-6;
const TARGETS: f64 = 8e-6;

/// The planned steps of a verb in order, and the done part of the bar.
#[derive(Debug, Default)]
pub struct Plan {
    /// Steps with their expected cost in any unit.
    stages: Vec<(Step, f64)>,
    /// Number of stages that have started or were skipped.
    begun: usize,
    /// Share of the bar before the current step.
    base: f64,
    /// Share of the bar that the current step takes.
    span: f64,
}

impl Plan {
    /// From these steps with their costs. A step that is not among them takes half of the rest of
    /// the bar before the next planned one.
    pub fn new(stages: Vec<(Step, f64)>) -> Self {
        Self { stages, ..Self::default() }
    }

    /// Begins a step; all steps before it are done.
    pub fn begin(&mut self, step: Step) {
        self.base += self.span;
        let found = self.stages.iter().skip(self.begun).position(|(own, _)| *own == step);
        match found {
            Some(skipped) => {
                let number = self.begun + skipped;
                self.base = self.base.max(self.end(number));
                self.begun = number + 1;
                self.span = self.end(self.begun) - self.base;
            }
            None => {
                let next = if self.begun < self.stages.len() { self.end(self.begun) } else { 1.0 };
                self.span = 0.5 * (next - self.base).max(0.0);
            }
        }
    }

    /// The done share of the bar, 0 to 1, at `done` of `total` parts of the current step.
    pub fn share(&self, done: u64, total: u64) -> f64 {
        let within = if total == 0 { 0.0 } else { (done as f64 / total as f64).min(1.0) };
        (self.base + self.span * within).min(1.0)
    }

    /// End of the first `count` stages on the bar.
    fn end(&self, count: usize) -> f64 {
        let cost = |stages: &[(Step, f64)]| stages.iter().map(|(_, cost)| cost).sum::<f64>();
        cost(&self.stages[..count]) / cost(&self.stages).max(f64::MIN_POSITIVE)
    }
}

/// The steps of a bake of a field of `nodes`, followed by pictures from `judges` cameras at full
/// size and smaller.
pub fn of_bake(options: &BakeOptions, nodes: Nodes, judges: &[Camera]) -> Vec<(Step, f64)> {
    let count = nodes.0.iter().map(|&nodes| nodes as f64).product::<f64>();
    let pixels = |cameras: &[Camera]| -> f64 {
        let pixels = |camera: &Camera| (camera.lens.width * camera.lens.height) as f64;
        cameras.iter().map(pixels).sum()
    };
    let mut stages = vec![(Step::Prune, PRUNE * count)];
    if options.sees() {
        stages.push((Step::Cover, PIXEL * pixels(judges)));
    }
    if options.filter.is_fitted() {
        let most = options.fit_seconds.unwrap_or(f64::INFINITY);
        let fit = (FIT * count).min(most);
        stages.extend([(Step::Targets, TARGETS * count), (Step::Fit, fit)]);
    }
    if options.max_error.is_some() {
        stages.push((Step::Ranges, RANGES * count));
    }
    stages.extend([(Step::Encode, ENCODE * count), (Step::Write, WRITE * count)]);
    if !judges.is_empty() {
        // A reference at full size, and the container at full size, a half, a quarter, an eighth.
        stages.push((Step::Render, PIXEL * pixels(judges) * 2.33));
    }
    stages
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_grows(plan: &mut Plan, steps: &[Step], ends_at: f64) {
        let mut last = 0.0;
        for &step in steps {
            plan.begin(step);
            for done in 0..=10 {
                let share = plan.share(done, 10);
                assert!(share >= last && share <= 1.0, "{step:?} {done}: {share} after {last}");
                last = share;
            }
        }
        assert!((last - ends_at).abs() < 1e-9, "{last}");
    }

    #[test]
    fn a_bar_only_grows_and_ends_full_where_all_was_planned() {
        let stages = || {
            vec![(Step::Prune, 1.0), (Step::Ranges, 2.0), (Step::Encode, 3.0), (Step::Write, 2.0)]
        };
        use Step::{Encode, Fit, Prune, Ranges, Render, Write};
        assert_grows(&mut Plan::new(stages()), &[Prune, Ranges, Encode, Write], 1.0);
        // Steps that are skipped, repeated, or not in the plan.
        assert_grows(&mut Plan::new(stages()), &[Prune, Encode, Write], 1.0);
        assert_grows(&mut Plan::new(stages()), &[Prune, Prune, Encode, Write, Render], 1.0);
        assert_grows(&mut Plan::new(stages()), &[Encode, Prune], 0.75);
        assert_grows(&mut Plan::new(Vec::new()), &[Render], 0.5);
        assert_grows(&mut Plan::new(Vec::new()), &[Prune, Fit, Encode], 0.875);
        let mut plan = Plan::new(stages());
        plan.begin(Prune);
        assert_eq!(plan.share(1, 2), 0.0625);
        assert_eq!(plan.share(0, 0), 0.0);
    }
}
