//! The samples of a ray that may be visible.

use super::footprint::Footprint;
use super::path::Path;
use crate::model::activate::lanes;
use crate::model::baked::StepRule;
use crate::model::camera::Ray;
use crate::view::sample::View;
use crate::view::sample::{Macro, SkipGrid};

/// A walk to all samples.
pub const EVERY_SAMPLE: [f64; 2] = [0.0, 1.0];

/// A ray's samples and their levels of detail.
#[derive(Debug, Clone, Copy)]
pub struct Route {
    /// Positions of samples.
    pub path: Path,
    footprint: Footprint,
    /// Bounds of the levels of detail; equal where it is one.
    range: [f32; 2],
}

impl Route {
    /// Through a field of `levels` levels; `neighbours` are the rays half a pixel aside along x and
    /// y, if the level depends on them. None if the ray misses the box.
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
        let range = footprint.range(path.first, path.last);
        Some(Self { path, footprint, range })
    }

    /// Visits samples front to back with their number, level of detail and the intervals that each
    /// stands for, until a visit says no. `[from, every]` leaves out so many samples at the entry,
    /// and takes one of so many.
    #[inline(always)]
    pub fn walk(
        &self,
        view: &View,
        skip: &SkipGrid,
        [from, every]: [f64; 2],
        mut visit: impl FnMut(f64, f32, f32) -> bool,
    ) {
        let Self { path, footprint, range: [lowest, highest] } = self;
        // Samples between two levels read both.
        let levels = [*lowest as usize, highest.ceil() as usize];
        let constant = lowest == highest;
        // Steps from one sample to the next, where they do not depend on the sample.
        let steps = match view.step_rule {
            StepRule::Constant => Some(1.0),
            StepRule::LevelOfDetail => constant.then(|| lanes::exp2(*lowest)),
        };
        let faces = skip.faces(path.start, path.step);
        let mut k = path.first + from;
        while k <= path.last {
            let place = skip.place(path.position(k));
            let state = skip.state(levels, place);
            let distance = if let Macro::Empty(distance) = state { distance } else { 1 };
            let leaves = faces.leaves(place, distance);
            if let (Macro::Empty(_), Some(steps)) = (state, steps) {
                // The first sample that has left; never the same again, however that is rounded.
                let steps = f64::from(steps) * every;
                k += ((leaves.min(path.last + 1.0) - k) / steps).ceil().max(1.0) * steps;
                continue;
            }
            loop {
                let lambda = if constant { *lowest } else { footprint.lambda(k) };
                let steps = every as f32 * steps.unwrap_or_else(|| lanes::exp2(lambda));
                let counts = match state {
                    Macro::Empty(_) => false,
                    Macro::Open => true,
                    Macro::Masked => view.keeps(path.position(k)),
                };
                if counts && !visit(k, lambda, steps * path.intervals()) {
                    return;
                }
                k += f64::from(steps);
                if k >= leaves || k > path.last {
                    break;
                }
            }
        }
    }
}
