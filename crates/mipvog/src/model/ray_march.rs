//! The common parts of all ray loops: the part of a ray inside a box, a bound on its samples, and
//! compositing.
//!
//! A family of models states its density, its colours and the places of its samples. Everything
//! else of its loop is here, once:
//!
//! ```text
//! [enters, leaves] = crossing(origin, direction, box, zero)
//! t_k = start + k step                                  Steps: k may skip what is empty
//! weight = alpha T,  T *= 1 - alpha                     Composite
//! weight = exp(-depth) (1 - exp(-own depth))            DepthComposite
//! colour = sum of weight colour + T background
//! ```

use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::field::March;
use crate::model::trained_model::{RayColor, RayRules};

/// How a model family avoids division by a direction component of 0.
#[derive(Debug, Clone, Copy)]
pub enum ZeroGuard {
    /// Replaces a component of 0.
    Replace(f64),
    /// Is added to every component before the reciprocal.
    Add(f64),
}

/// The unit direction of a ray.
pub fn unit_direction(ray: &Ray) -> [f64; 3] {
    (ray.direction / ray.direction.length()).to_array()
}

/// The point of a ray at a distance, in lengths of `direction`.
#[inline]
pub fn point_at(origin: [f64; 3], direction: [f64; 3], distance: f64) -> [f64; 3] {
    let mut at = origin;
    at.iter_mut().zip(direction).for_each(|(at, by)| *at += distance * by);
    at
}

/// Entry of a ray into a box and its exit, in lengths of `direction`. A ray that misses the box
/// leaves before it enters.
pub fn crossing(
    origin: [f64; 3],
    direction: [f64; 3],
    corners: [[f64; 3]; 2],
    guard: ZeroGuard,
) -> [f64; 2] {
    match guard {
        ZeroGuard::Replace(least) => {
            let direction = direction.map(|by| if by == 0.0 { least } else { by });
            slabs(origin, direction, corners, |length, by| length / by)
        }
        ZeroGuard::Add(more) => crossing_by(origin, direction.map(|by| 1.0 / (by + more)), corners),
    }
}

/// The same by the reciprocals of a direction.
#[inline]
pub fn crossing_by(origin: [f64; 3], reciprocals: [f64; 3], corners: [[f64; 3]; 2]) -> [f64; 2] {
    slabs(origin, reciprocals, corners, |length, by| length * by)
}

#[inline]
fn slabs(
    origin: [f64; 3],
    along: [f64; 3],
    [low, high]: [[f64; 3]; 2],
    distance: impl Fn(f64, f64) -> f64,
) -> [f64; 2] {
    let axes = origin.into_iter().zip(along).zip(low.into_iter().zip(high));
    axes.fold([f64::NEG_INFINITY, f64::INFINITY], |[enters, leaves], ((from, by), (low, high))| {
        let (a, b) = (distance(low - from, by), distance(high - from, by));
        [enters.max(a.min(b)), leaves.min(a.max(b))]
    })
}

/// The samples that a ray may still take. Every ray loop requests each sample here, so that it ends
/// for every ray and model, and notices a request to stop.
pub struct SampleBudget<'a> {
    left: u32,
    progress: &'a dyn Progress,
}

/// Samples between two checks for a request to stop.
const UNHEARD: u32 = 256;

impl<'a> SampleBudget<'a> {
    /// For a ray with a first sample at a distance and steps of `step`. None if the ray starts so
    /// far away that a step is lost in rounding: it would never advance.
    pub fn new(start: f64, step: f64, progress: &'a dyn Progress) -> Self {
        let left = if start + step > start { March::MAX_SAMPLES } else { 0 };
        Self { left, progress }
    }

    /// Takes a sample, if any is left. After a request to stop none is left, and the ray is
    /// incomplete.
    #[inline]
    pub fn take(&mut self) -> bool {
        let is_left =
            self.left > 0 && !(self.left.is_multiple_of(UNHEARD) && self.progress.cancelled());
        self.left = if is_left { self.left - 1 } else { 0 };
        is_left
    }
}

/// Samples a whole number of steps from the first one.
#[derive(Debug, Clone, Copy)]
pub struct Steps {
    /// Distance of step 0.
    pub start: f64,
    /// From one to the next.
    pub step: f64,
    /// No sample is farther.
    pub end: f64,
}

/// The next step after a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// The next one.
    Step,
    /// The sample of this number, or the next one if that is later.
    Number(f64),
    /// None.
    End,
}

/// Steps that are even near the camera, grow with the distance from it farther out, and are even
/// again far away.
///
/// ```text
/// step = least         up to t = least / ln(1 + growth)
///        growth t      up to t = most / ln(1 + growth)
///        most          beyond
/// ```
#[derive(Debug, Clone, Copy)]
pub struct GrowingSteps {
    least: f64,
    most: f64,
    /// Natural logarithm of the ratio of a distance to the one before.
    log_ratio: f64,
    /// Distances at which steps start and stop growing.
    bends: [f64; 2],
}

impl GrowingSteps {
    /// Steps from a shortest to a longest length, proportional to the distance in between.
    pub fn new(least: f64, most: f64, growth: f64) -> Self {
        let log_ratio = libm::log1p(growth);
        Self { least, most, log_ratio, bends: [least / log_ratio, most / log_ratio] }
    }

    /// The number of steps to a distance, up to a constant.
    pub fn number(&self, distance: f64) -> f64 {
        let [near, far] = self.bends;
        let of_bend = |bend: f64| libm::log(bend) / self.log_ratio;
        if distance <= near {
            (distance - near) / self.least + of_bend(near)
        } else if distance <= far {
            of_bend(distance)
        } else {
            (distance - far) / self.most + of_bend(far)
        }
    }

    /// The distance of a number of steps.
    pub fn distance(&self, number: f64) -> f64 {
        let [near, far] = self.bends;
        let [at_near, at_far] = self.bends.map(|bend| libm::log(bend) / self.log_ratio);
        if number <= at_near {
            (number - at_near) * self.least + near
        } else if number <= at_far {
            libm::exp(number * self.log_ratio)
        } else {
            (number - at_far) * self.most + far
        }
    }
}

/// Visits samples at any spacing, front to back, until no sample follows, a visit returns the end,
/// or the limit of samples is reached. [`Next::Number`] is a step here.
pub fn walk(
    mut next: impl FnMut() -> Option<f64>,
    progress: &dyn Progress,
    mut visit: impl FnMut(f64) -> Next,
) {
    let mut left = SampleBudget::new(0.0, 1.0, progress);
    while left.take() {
        let Some(t) = next() else { return };
        if visit(t) == Next::End {
            return;
        }
    }
}

impl Steps {
    /// Visits the samples by their distances, front to back, from number `first` on, up to the
    /// limit of samples.
    pub fn walk(&self, first: f64, progress: &dyn Progress, mut visit: impl FnMut(f64) -> Next) {
        let Self { start, step, end } = *self;
        let mut number = first;
        let mut left = SampleBudget::new(start, step, progress);
        while left.take() {
            let t = start + number * step;
            if t > end {
                return;
            }
            match visit(t) {
                Next::Step => number += 1.0,
                Next::Number(later) => number = later.max(number + 1.0),
                Next::End => return,
            }
        }
    }

    /// The number of the sample at a distance or the last one before it.
    pub fn number_before(&self, distance: f64) -> f64 {
        ((distance - self.start) / self.step).floor()
    }
}

/// Front-to-back compositing by opacities, with `N` accumulated values.
#[derive(Debug, Clone, Copy)]
pub struct Composite<const N: usize> {
    /// Light left behind all samples so far, 0 to 1.
    pub transmittance: f64,
    /// Weighted sums of colours and features.
    pub sums: [f64; N],
    /// Weighted sum of distances, in world units.
    pub distance: f64,
}

impl<const N: usize> Default for Composite<N> {
    fn default() -> Self {
        Self { transmittance: 1.0, sums: [0.0; N], distance: 0.0 }
    }
}

impl<const N: usize> Composite<N> {
    /// Adds a sample of an opacity at a distance. `color` gets its weight, and returns the sample's
    /// values, if any.
    #[inline]
    pub fn add(&mut self, alpha: f64, distance: f64, color: impl FnOnce(f64) -> Option<[f64; N]>) {
        let weight = alpha * self.transmittance;
        self.transmittance *= 1.0 - alpha;
        self.distance += weight * distance;
        for (sum, value) in self.sums.iter_mut().zip(color(weight).into_iter().flatten()) {
            *sum += weight * value;
        }
    }

    /// Adds a sample with premultiplied values.
    #[inline]
    pub fn add_premultiplied(&mut self, alpha: f64, distance: f64, values: [f64; N]) {
        for (sum, value) in self.sums.iter_mut().zip(values) {
            *sum += self.transmittance * value;
        }
        self.distance += self.transmittance * alpha * distance;
        self.transmittance *= 1.0 - alpha;
    }

    /// Divides the sums by the opacity, and leaves no light: for models that end rays this way.
    pub fn divide_by_opacity(&mut self) {
        let opacity = 1.0 - self.transmittance;
        self.sums = self.sums.map(|sum| sum / opacity);
        (self.distance, self.transmittance) = (self.distance / opacity, 0.0);
    }

    /// The first three sums over the background.
    pub fn over_background(&self, rules: &RayRules) -> RayColor {
        let color = [0, 1, 2].map(|channel| self.sums.get(channel).copied().unwrap_or(0.0));
        let color = over_background(color, self.transmittance, rules);
        ray_color(color, self.transmittance, self.distance, rules)
    }
}

/// Front-to-back compositing by optical depths.
#[derive(Debug, Clone, Copy, Default)]
pub struct DepthComposite {
    /// Optical depth so far.
    pub depth: f64,
    color: [f64; 3],
    /// Weighted sum of distances.
    pub distance: f64,
}

impl DepthComposite {
    /// Adds an optical depth with a colour, at a distance.
    pub fn add(&mut self, depth: f64, at: f64, seen: [f64; 3]) {
        let weight = -libm::exp(-self.depth) * libm::expm1(-depth);
        self.color.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += weight * seen);
        self.distance += weight * at;
        self.depth += depth;
    }

    /// The light left behind all samples so far.
    pub fn transmittance(&self) -> f64 {
        libm::exp(-self.depth)
    }

    /// Sums of colours.
    pub fn color(&self) -> [f64; 3] {
        self.color
    }

    /// The light over the background.
    pub fn over_background(&self, rules: &RayRules) -> RayColor {
        let transmittance = self.transmittance();
        let color = over_background(self.color, transmittance, rules);
        ray_color(color, transmittance, self.distance, rules)
    }
}

/// Sums of colours over the background.
pub fn over_background(sums: [f64; 3], transmittance: f64, rules: &RayRules) -> [f64; 3] {
    let mut color = sums;
    let background = rules.background.map(f64::from);
    color.iter_mut().zip(background).for_each(|(sum, behind)| *sum += transmittance * behind);
    color
}

/// The light of a ray from its sums. Light that passes through has the depth `far`, if given.
#[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
pub fn ray_color(color: [f64; 3], transmittance: f64, distance: f64, rules: &RayRules) -> RayColor {
    let distance = distance + transmittance * rules.far.map_or(0.0, f64::from);
    let color = color.map(|value| value as f32);
    RayColor { color, transmittance: transmittance as f32, distance: distance as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;

    const UNIT: [[f64; 3]; 2] = [[0.0; 3], [1.0; 3]];

    #[test]
    fn rays_cross_boxes() {
        for guard in [ZeroGuard::Replace(1e-300), ZeroGuard::Add(1e-300)] {
            let through = crossing([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0], UNIT, guard);
            assert_eq!(through, [1.0, 2.0]);
            let [enters, leaves] = crossing([-1.0, 1.5, 0.5], [1.0, 0.0, 0.0], UNIT, guard);
            assert!(enters > leaves, "a ray beside the box misses it");
        }
    }

    #[test]
    fn no_walk_is_endless() {
        for start in [0.0, 1e6, 1e12, 1e25, f64::INFINITY, f64::NAN] {
            let mut visits = 0;
            let steps = Steps { start, step: 1e-3, end: f64::INFINITY };
            steps.walk(0.0, &Silent, |_| {
                visits += 1;
                // NaN must not loop forever.
                Next::Number(f64::NAN)
            });
            assert!(visits <= March::MAX_SAMPLES, "{start}");
            assert_eq!(visits == 0, start > 1e13 || start.is_nan(), "{start}: {visits}");
        }
    }

    #[test]
    fn steps_grow_with_the_distance() {
        let steps = GrowingSteps::new(0.01, 1.0, 1.0 / 256.0);
        for distance in [0.0, 1.0, 2.6, 40.0, 255.0, 300.0, 1e6] {
            let number = steps.number(distance);
            assert!((steps.distance(number) - distance).abs() < 1e-9 * (1.0 + distance));
            let step = steps.distance(number + 1.0) - distance;
            let expected = (distance / 256.0).clamp(0.01, 1.0);
            assert!((step / expected - 1.0).abs() < 0.01, "{step} at {distance}");
        }
    }

    #[test]
    fn both_sums_are_the_same_light() {
        let rules = RayRules { near: 0.0, far: Some(9.0), background: [0.25, 0.5, 1.0] };
        let (mut by_opacity, mut by_depth) = (Composite::<3>::default(), DepthComposite::default());
        for (depth, at) in [(0.3, 1.0), (1.2, 2.0), (0.05, 4.0)] {
            let seen = [at / 4.0, 0.5, 0.1];
            by_opacity.add(-libm::expm1(-depth), at, |_| Some(seen));
            by_depth.add(depth, at, seen);
        }
        let [a, b] = [by_opacity.over_background(&rules), by_depth.over_background(&rules)];
        assert!((a.transmittance - b.transmittance).abs() < 1e-6);
        assert!((a.distance - b.distance).abs() < 1e-5);
        assert!(a.color.iter().zip(b.color).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
