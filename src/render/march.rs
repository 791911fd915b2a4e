//! One ray.

use super::footprint::Footprint;
use super::packet::{Packet, Sums};
use super::path::Path;
use super::view::View;
use crate::activate::lanes;
use crate::baked::StepRule;
use crate::camera::Ray;
use crate::sample::{Macro, Sample};

/// Optical depth from which a ray ends: transmittance 1e-5, a hundredth of an 8-bit step over white.
const OPAQUE_DEPTH: f64 = 11.6;

/// What a ray gathers.
#[derive(Debug, Clone, Copy)]
pub struct Gathered<const C: usize> {
    /// Weighted activated colour and features.
    pub color: [f32; C],
    /// Light left behind the field.
    pub transmittance: f32,
    /// Weighted distance from the camera, in world units.
    pub distance: f32,
    /// Weighted level.
    pub level: f32,
    /// Samples that were interpolated.
    pub samples: u32,
    /// Samples between entry and exit, looked at or not.
    pub steps: u32,
}

/// Follows a ray; `aside` are the rays half a pixel aside along x and y, if the level depends on them.
pub fn march<const C: usize>(
    view: &View,
    field: &impl Sample<C>,
    ray: &Ray,
    aside: Option<[Ray; 2]>,
    fixed_level: Option<usize>,
) -> Gathered<C> {
    let mut sums = Sums::nothing();
    let Some(path) = Path::new(view, ray) else { return Gathered::of(&sums, 0) };
    let steps = (path.last - path.first) as u32 + 1;
    let footprint = match (fixed_level, aside, &view.level_of_detail) {
        (Some(level), _, _) => Footprint::fixed(level.min(field.levels() - 1)),
        (None, Some(aside), Some(rule)) => {
            let sides = aside.map(|other| path.offsets(view, rule.aside, &other));
            Footprint::new(sides, rule, field.levels())
        }
        _ => Footprint::fixed(0),
    };
    let [least, most] = footprint.range(path.first, path.last);
    let levels = [least as usize, most as usize];
    let constant = least == most;
    let skip = field.skip();
    let mut packet = Packet::empty();
    let mut k = path.first;
    // Intervals from one sample to the next, where they do not depend on the sample.
    let interval = match view.step_rule {
        StepRule::Constant => Some(1.0),
        StepRule::LevelOfDetail => constant.then(|| least.exp2()),
    };
    while k <= path.last && sums.depth < OPAQUE_DEPTH {
        let place = skip.place(path.position(k));
        let state = skip.state(levels, place);
        let room = if let Macro::Empty(room) = state { room } else { 1 };
        let leaves = skip.leaves(place, room, path.start, path.step);
        if let (Macro::Empty(_), Some(interval)) = (state, interval) {
            // The first sample that has left; never the same again, however that is rounded.
            let interval = f64::from(interval);
            k += ((leaves.min(path.last + 1.0) - k) / interval).ceil().max(1.0) * interval;
            continue;
        }
        loop {
            let lambda = if constant { least } else { footprint.lambda(k) };
            let level = lambda as usize;
            let interval = interval.unwrap_or_else(|| lambda.exp2());
            let seen = match state {
                Macro::Empty(_) => false,
                Macro::Open => true,
                Macro::Masked => view.keeps(path.position(k)),
            };
            if seen {
                if packet.refuses(level) {
                    packet.shade(view, field, &path, &mut sums);
                }
                packet.push(k, level, lambda - level as f32, interval);
            }
            k += f64::from(interval);
            if k >= leaves || k > path.last || sums.depth >= OPAQUE_DEPTH {
                break;
            }
        }
    }
    packet.shade(view, field, &path, &mut sums);
    Gathered::of(&sums, steps)
}

impl<const C: usize> Gathered<C> {
    fn of(sums: &Sums<C>, steps: u32) -> Self {
        Self {
            color: sums.color.map(|sum| sum as f32),
            transmittance: lanes::exp(-sums.depth as f32),
            distance: sums.distance as f32,
            level: sums.level as f32,
            samples: sums.samples,
            steps,
        }
    }
}

impl View {
    /// Whether the free-space mask keeps a sample.
    fn keeps(&self, position: [f64; 3]) -> bool {
        let Some(free_space) = &self.free_space else { return true };
        let extent = self.bounds.extent();
        let world =
            [0, 1, 2].map(|axis| f64::from(self.bounds.min[axis]) + position[axis] * extent[axis]);
        free_space.contains(world)
    }
}
