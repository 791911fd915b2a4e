//! The samples of a ray that may be visible.

use super::footprint::Footprint;
use super::nested_route::{Crossings, Region};
use super::path::Path;
use crate::model::activate::lanes;
use crate::model::baked::StepRule;
use crate::model::camera::Ray;
use crate::view::sample::View;
use crate::view::sample::{Macro, SkipGrid};

/// A walk that visits all samples.
pub const EVERY_SAMPLE: [f64; 2] = [0.0, 1.0];

/// A sample that may be visible.
#[derive(Debug, Clone, Copy)]
pub struct RouteSample {
    /// Index of the sample.
    pub k: f64,
    /// Level of detail.
    pub lambda: f32,
    /// Number of intervals that the sample stands for.
    pub intervals: f32,
    /// Index of the smallest nested box around the sample; 0 if there is one box.
    pub number: usize,
}

/// A ray's samples and their levels of detail.
#[derive(Debug, Clone, Copy)]
pub struct Route {
    /// Positions of the samples.
    pub path: Path,
    footprint: Footprint,
}

impl Route {
    /// The route of a ray through a field of `levels` levels. `neighbours` are the rays half a
    /// pixel aside along x and y, if the level depends on them. `None` if the ray misses the box.
    pub fn new(
        view: &View,
        levels: usize,
        ray: &Ray,
        neighbours: Option<[Ray; 2]>,
        fixed_level: Option<usize>,
    ) -> Option<Self> {
        let path = Path::new(view, ray)?;
        let footprint = match (fixed_level, neighbours, &view.level_of_detail) {
            (Some(level), _, _) => Footprint::fixed(level.min(levels - 1).max(view.finest)),
            (None, Some(neighbours), Some(rule)) => {
                let sides = neighbours.map(|other| path.offsets(view, rule.neighbour, &other));
                Footprint::new(sides, rule, [view.finest, levels - 1])
            }
            _ => Footprint::fixed(view.finest),
        };
        Some(Self { path, footprint })
    }

    /// Visits samples front to back until a visit returns false. `[from, every]` skips `from`
    /// samples at the entry, then visits every `every`-th sample. `skip` has the empty space of
    /// each nested box.
    #[inline(always)]
    pub fn walk<'s>(
        &self,
        view: &View,
        skip: impl Fn(usize) -> &'s SkipGrid,
        [from, every]: [f64; 2],
        mut visit: impl FnMut(RouteSample) -> bool,
    ) {
        let mut k = self.path.first + from;
        if view.boxes.is_empty() {
            let region = Region::whole(&self.path);
            self.walk_region(view, skip(0), &region, every, k, &mut visit);
            return;
        }
        let crossings = Crossings::new(&self.path, &view.boxes);
        while k <= self.path.last {
            let region = crossings.region(&self.path, &view.boxes, k);
            let next = self.walk_region(view, skip(region.number), &region, every, k, &mut visit);
            let Some(next) = next else { return };
            k = next;
        }
    }

    /// Visits the samples of a region from `k` on. Returns the index of the sample after them, or
    /// `None` if a visit returned false.
    #[inline(always)]
    fn walk_region(
        &self,
        view: &View,
        skip: &SkipGrid,
        region: &Region,
        every: f64,
        mut k: f64,
        visit: &mut impl FnMut(RouteSample) -> bool,
    ) -> Option<f64> {
        let Self { path, footprint } = self;
        let number = region.number;
        let least = number as f32;
        let [lowest, highest] =
            footprint.range(region.first, region.last).map(|level| level.max(least));
        // Samples between two levels read both.
        let levels = [lowest as usize - number, highest.ceil() as usize - number];
        let constant = lowest == highest;
        // Steps from one sample to the next, if constant.
        let steps = match view.step_rule {
            StepRule::Constant => Some(lanes::exp2(least)),
            StepRule::LevelOfDetail => constant.then(|| lanes::exp2(lowest)),
        };
        let faces = skip.faces(region.start, region.step);
        while k <= region.last {
            let place = skip.place(region.position(k));
            let state = skip.state(levels, place);
            let distance = if let Macro::Empty(distance) = state { distance } else { 1 };
            let leaves = faces.leaves(place, distance);
            if let (Macro::Empty(_), Some(steps)) = (state, steps) {
                // The first sample behind it; never the same sample again, whatever the rounding.
                let steps = f64::from(steps) * every;
                let passed = ((leaves.min(region.end) - k) / steps).ceil().max(1.0) * steps;
                k = region.entered(k + passed - steps, k + passed);
                continue;
            }
            loop {
                let lambda = if constant { lowest } else { footprint.lambda(k).max(least) };
                let mut steps = every as f32 * steps.unwrap_or_else(|| lanes::exp2(lambda));
                let next = region.entered(k, k + f64::from(steps));
                if region.is_entered {
                    steps = (next - k) as f32;
                }
                let counts = match state {
                    Macro::Empty(_) => false,
                    Macro::Open => true,
                    Macro::Masked => view.keeps(path.position(k)),
                };
                let intervals = steps * path.intervals();
                if counts && !visit(RouteSample { k, lambda, intervals, number }) {
                    return None;
                }
                k = next;
                if k >= leaves || k > region.last {
                    break;
                }
            }
        }
        Some(k)
    }
}
