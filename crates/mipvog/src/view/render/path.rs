//! The samples of a ray.

use crate::model::anisotropy::{ANISOTROPY, functions};
use crate::model::baked::FootprintNeighbour;
use crate::model::camera::Ray;
use crate::model::grid::BoxFrame;
use crate::view::sample::View;

/// A sample at most this far from a face, as a fraction of the box, lies on it. Rays enter at
/// faces, and rounding must not decide whether the first sample counts.
const ON_FACE: f64 = 1e-9;

/// A ray in the field's own coordinates: sample `k` is at `start + k * step`, `0..=1` along each
/// axis.
#[derive(Debug, Clone, Copy)]
pub struct Path {
    /// Position of sample 0.
    pub start: [f64; 3],
    /// Step from one sample to the next.
    pub step: [f64; 3],
    /// Index of the first sample inside the box.
    pub first: f64,
    /// End of the samples.
    pub last: f64,
    /// `t` of sample 0, and for each step.
    entry: f64,
    t_step: f64,
    /// World units per unit of `t`.
    length: f64,
    /// Intervals per step.
    intervals: f32,
    /// The anisotropy functions in the ray's direction; zeros if no level has anisotropy.
    pub along: [f32; ANISOTROPY],
}

impl Path {
    /// The part of the ray inside the box; `None` if the ray misses the box.
    pub fn new(view: &View, ray: &Ray) -> Option<Self> {
        let (entry, length) = (entry_t(view, ray), ray.direction.length());
        let step_length = step_length(view, ray);
        let t_step = step_length / length;
        let intervals = (step_length / view.march.interval_length()) as f32;
        let (start, step) = samples(view, ray, entry, t_step);
        // The first and the last sample inside, along every axis.
        let (mut first, mut last) = (0.0f64, view.last_sample());
        for (axis, [low, high]) in view.march.sampled_shares(&view.bounds).into_iter().enumerate() {
            let (from, by) = (start[axis], step[axis]);
            if by == 0.0 {
                if !(low - ON_FACE..=high + ON_FACE).contains(&from) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - ON_FACE - from) / by, (high + ON_FACE - from) / by);
            first = first.max(a.min(b).ceil());
            last = last.min(a.max(b));
        }
        if let Some(reach) = view.reach {
            last = last.min((reach / length - entry) / t_step);
        }
        if first > last {
            return None;
        }
        let along = match view.anisotropic {
            true => functions((ray.direction / length).to_array()),
            false => [0.0; ANISOTROPY],
        };
        Some(Self { start, step, first, last, entry, t_step, length, intervals, along })
    }

    /// Position of sample `k`.
    #[inline(always)]
    pub fn position(&self, k: f64) -> [f64; 3] {
        let along = |axis: usize| (self.start[axis] + k * self.step[axis]).clamp(0.0, 1.0);
        [along(0), along(1), along(2)]
    }

    /// Offset of the samples of `other`, a ray half a pixel aside, in voxels per pixel: at sample
    /// 0, and its change per step.
    pub fn offsets(
        &self,
        view: &View,
        neighbour: FootprintNeighbour,
        other: &Ray,
    ) -> [[f64; 3]; 2] {
        let (start, step) = match neighbour {
            FootprintNeighbour::SameIndex => {
                let t_step = step_length(view, other) / other.direction.length();
                samples(view, other, entry_t(view, other), t_step)
            }
            FootprintNeighbour::SameDistance => samples(view, other, self.entry, self.t_step),
        };
        // Positions are in shares of the box, which is N voxels long along an axis.
        let along = view.voxels();
        let voxels = |axis: usize| 2.0 * along[axis];
        [
            [0, 1, 2].map(|axis| (start[axis] - self.start[axis]) * voxels(axis)),
            [0, 1, 2].map(|axis| (step[axis] - self.step[axis]) * voxels(axis)),
        ]
    }

    /// The samples in a nested box, including its faces: indices of the first and the last,
    /// possibly fractional. `None` if the ray misses the box.
    pub fn within(&self, frame: &BoxFrame) -> Option<[f64; 2]> {
        let (start, step) = self.placed_in(frame);
        let (mut first, mut last) = (self.first, self.last);
        for (from, by) in start.into_iter().zip(step) {
            if by == 0.0 {
                if !(-ON_FACE..=1.0 + ON_FACE).contains(&from) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-ON_FACE - from) / by, (1.0 + ON_FACE - from) / by);
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
        (first <= last).then_some([first, last])
    }

    /// Sample 0 and the step, as fractions of a nested box.
    pub fn placed_in(&self, frame: &BoxFrame) -> ([f64; 3], [f64; 3]) {
        let step = [0, 1, 2].map(|axis| self.step[axis] * frame.scale[axis]);
        (frame.place(self.start), step)
    }

    /// Intervals per step: one, unless voxels are not cubes.
    pub fn intervals(&self) -> f32 {
        self.intervals
    }

    /// Distance of sample `k` from the camera, in world units.
    pub fn distance(&self, k: f64) -> f64 {
        (self.entry + k * self.t_step) * self.length
    }
}

/// `t` at which a ray enters the sampled box, clamped to near and far.
fn entry_t(view: &View, ray: &Ray) -> f64 {
    let mut entry = f64::NEG_INFINITY;
    let extent = view.bounds.extent();
    for (axis, [low, high]) in view.march.sampled_shares(&view.bounds).into_iter().enumerate() {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        // A ray along a face, or very close to it, is between the faces either from the start or
        // never.
        if direction == 0.0 {
            continue;
        }
        let first = f64::from(view.bounds.min[axis]);
        let [min, max] = [low, high].map(|share| first + share * extent[axis]);
        entry = entry.max(((min - origin) / direction).min((max - origin) / direction));
    }
    let far = view.march.far.map_or(f64::INFINITY, f64::from);
    entry.max(f64::from(view.march.near)).min(far)
}

/// Length of a ray's steps in world units.
fn step_length(view: &View, ray: &Ray) -> f64 {
    view.march.step_length((ray.direction / ray.direction.length()).to_array())
}

/// Sample 0 at `t = entry` and the step of `t_step`, `0..=1` along each axis of the box.
fn samples(view: &View, ray: &Ray, entry: f64, t_step: f64) -> ([f64; 3], [f64; 3]) {
    let extent = view.bounds.extent();
    let start =
        [0, 1, 2].map(|axis| to_box(view, axis, ray.origin[axis] + ray.direction[axis] * entry));
    (start, [0, 1, 2].map(|axis| ray.direction[axis] * t_step / extent[axis]))
}

fn to_box(view: &View, axis: usize, world: f64) -> f64 {
    (world - f64::from(view.bounds.min[axis])) / view.bounds.extent()[axis]
}
