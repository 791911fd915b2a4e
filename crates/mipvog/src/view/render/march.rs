//! Marches one ray.

use super::color_rule::ColorRule;
use super::packet::{Packet, Sums};
use super::route::{EVERY_SAMPLE, Route, RouteSample};
use crate::model::activate::lanes;
use crate::model::camera::Ray;
use crate::view::sample::SampleLevels;
use crate::view::sample::View;

/// Optical depth at which a ray ends: transmittance 1e-5, a hundredth of an 8-bit step over white.
pub(super) const OPAQUE_DEPTH: f64 = 11.6;

/// Sums along a ray.
#[derive(Debug, Clone, Copy)]
pub struct Gathered<const C: usize> {
    /// Weighted sum of activated colours and features.
    pub color: [f32; C],
    /// Transmittance of the whole ray, 0 to 1.
    pub transmittance: f32,
    /// Weighted sum of distances from the camera, in world units.
    pub distance: f32,
    /// Weighted sum of levels.
    pub level: f32,
    /// Number of interpolated samples.
    pub samples: u32,
    /// Number of samples between entry and exit, visited or skipped.
    pub steps: u32,
}

/// Marches a ray. `neighbours` are the rays half a pixel aside along x and y, if the level depends
/// on them.
pub fn march<const C: usize>(
    view: &View,
    field: &impl SampleLevels<C>,
    ray: &Ray,
    neighbours: Option<[Ray; 2]>,
    fixed_level: Option<usize>,
) -> Gathered<C> {
    let mut sums = Sums::nothing();
    let direction = ray.direction / ray.direction.length();
    let rule = ColorRule::of(view, direction.to_array());
    let Some(route) = Route::new(view, field.levels(), ray, neighbours, fixed_level) else {
        return Gathered::of(&sums, &rule, 0);
    };
    let path = &route.path;
    let steps = (path.last - path.first) as u32 + 1;
    let mut packet = Packet::empty();
    route.walk(
        view,
        |number| field.skip(number),
        EVERY_SAMPLE,
        |sample| {
            let RouteSample { k, lambda, intervals, number } = sample;
            let level = lambda as usize;
            let part = field.part(level, number);
            if packet.refuses(part) {
                packet.shade(view, field, path, &rule, &mut sums);
            }
            packet.push(k, [level, part], lambda - level as f32, intervals);
            sums.depth < OPAQUE_DEPTH
        },
    );
    packet.shade(view, field, path, &rule, &mut sums);
    Gathered::of(&sums, &rule, steps)
}

impl<const C: usize> Gathered<C> {
    fn of(sums: &Sums<C>, rule: &ColorRule, steps: u32) -> Self {
        let mut color = sums.color.map(|sum| sum as f32);
        rule.finish(&mut color);
        Self {
            color,
            transmittance: lanes::exp(-sums.depth as f32),
            distance: sums.distance as f32,
            level: sums.level as f32,
            samples: sums.samples,
            steps,
        }
    }
}
