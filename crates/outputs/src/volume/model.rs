//! A volume that was written and read back, rendered by the rules of effects programs and engines.
//!
//! Stored values are interpolated: activated density, and colour independent of density. Rays are
//! composited in linear light, including the background, and the sum is converted to sRGB at the
//! end.

use std::collections::HashMap;

use super::leaf::SIDE;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::base::srgb::{display, linear};
use crate::model::camera::Ray;
use crate::model::ray_march::{
    DepthComposite, Next, Steps, ZeroGuard, crossing, over_background, point_at, ray_color,
    unit_direction,
};
use crate::model::trained_model::{RayColor, RayRules, TrainedModel};

/// Samples between two points.
const SAMPLES: f64 = 2.0;
/// Optical depth at which a ray ends.
const OPAQUE: f64 = 11.6;
/// Opacities are clamped to 1 minus this.
const CLEAREST: f32 = 1e-6;
/// Marks places without a leaf, all of whose cells are empty.
const EMPTY: u32 = u32::MAX;
/// Marks places without a leaf, some of whose cells end at points of leaves above them.
const BORDER: u32 = u32::MAX - 1;

/// The meaning of the first value of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extinction {
    /// Optical depth per world unit.
    Density,
    /// Opacity over this length in world units.
    Opacity(f64),
}

/// Points after reading back.
#[derive(Debug)]
pub struct VolumePoints {
    /// World position of point 0, and distance of neighbours.
    pub first: [f64; 3],
    /// Distance of neighbours along each axis.
    pub spacing: [f64; 3],
    /// Meaning of the first values.
    pub extinction: Extinction,
    /// Rays are marched between these places along each axis, in steps from point 0. None: wherever
    /// there are leaves.
    pub faces: Option<[[f64; 2]; 3]>,
    /// By leaf number: density or opacity, and linear red, green and blue of its points.
    pub leaves: HashMap<[i32; 3], Vec<[f32; 4]>>,
}

/// The same, ready for rays.
#[derive(Debug)]
pub struct VolumeModel {
    first: [f64; 3],
    spacing: [f64; 3],
    extinction: Extinction,
    /// Number of the lowest leaf along each axis, and how many there are.
    lowest: [i32; 3],
    counts: [usize; 3],
    /// Rays are marched between these places along each axis, in steps.
    faces: [[f64; 2]; 3],
    /// Leaf of each place, or [`EMPTY`] or [`BORDER`].
    table: Vec<u32>,
    leaves: Vec<Vec<[f32; 4]>>,
}

impl VolumeModel {
    /// Finds the place of each leaf.
    ///
    /// # Errors
    ///
    /// More memory than the limits allow.
    pub fn new(points: VolumePoints, limits: &Limits) -> Result<Self> {
        let VolumePoints { first, spacing, extinction, faces, leaves } = points;
        let mut leaves: Vec<_> = leaves.into_iter().collect();
        leaves.sort_unstable_by_key(|(at, _)| *at);
        // A cell belongs to the place of its lowest point, which can be below all leaves.
        let numbers = |axis: usize| leaves.iter().map(move |(at, _)| at[axis]);
        let lowest = [0, 1, 2].map(|axis| numbers(axis).min().map_or(0, |low| low - 1));
        let highest = [0, 1, 2].map(|axis| numbers(axis).max().unwrap_or(-1));
        let counts: [usize; 3] =
            std::array::from_fn(|axis| (highest[axis] - lowest[axis] + 1).max(0) as usize);
        let mut budget = Budget::new(limits);
        let what = "bytes of a volume's table";
        let places = counts.iter().try_fold(1usize, |n, &count| n.checked_mul(count));
        let mut table: Vec<u32> =
            budget.zeroed(places.unwrap_or(usize::MAX), what, &Place::File)?;
        table.fill(EMPTY);
        for (number, (at, _)) in leaves.iter().enumerate() {
            for corner in 0..8usize {
                let down = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let [x, y, z] =
                    std::array::from_fn(|axis| (at[axis] - lowest[axis]) as usize - down[axis]);
                let place = &mut table[(x * counts[1] + y) * counts[2] + z];
                *place = match *place {
                    _ if corner == 0 => number as u32,
                    EMPTY => BORDER,
                    other => other,
                };
            }
        }
        let all = [0, 1, 2].map(|axis| {
            let low = f64::from(lowest[axis]) * SIDE as f64;
            [low, low + (counts[axis] * SIDE) as f64]
        });
        let faces = faces.unwrap_or(all);
        let leaves = leaves.into_iter().map(|(_, values)| values).collect();
        Ok(Self { first, spacing, extinction, lowest, counts, faces, table, leaves })
    }

    /// The leaf of a point, or [`BORDER`], and the point in it; none where all cells are empty.
    fn leaf(&self, point: [i64; 3]) -> Option<(u32, [usize; 3])> {
        let side = SIDE as i64;
        let mut place = [0; 3];
        for axis in 0..3 {
            let at = point[axis].div_euclid(side) - i64::from(self.lowest[axis]);
            place[axis] = usize::try_from(at).ok().filter(|&at| at < self.counts[axis])?;
        }
        let number = self.table[(place[0] * self.counts[1] + place[1]) * self.counts[2] + place[2]];
        (number != EMPTY).then(|| (number, point.map(|at| at.rem_euclid(side) as usize)))
    }

    /// The values of a point.
    fn point(&self, at: [i64; 3]) -> [f32; 4] {
        match self.leaf(at) {
            Some((number, [x, y, z])) if number != BORDER => {
                self.leaves[number as usize][(x * SIDE + y) * SIDE + z]
            }
            _ => [0.0; 4],
        }
    }

    /// Interpolated values at a place, in distances of points.
    fn at(&self, place: [f64; 3]) -> Option<[f32; 4]> {
        let low = place.map(|at| at.floor());
        let cell = low.map(|at| at as i64);
        let (number, [x, y, z]) = self.leaf(cell)?;
        let is_inside = number != BORDER && [x, y, z].iter().all(|at| at + 1 < SIDE);
        let leaf = if is_inside { Some(&self.leaves[number as usize]) } else { None };
        let fraction: [f32; 3] = std::array::from_fn(|axis| (place[axis] - low[axis]) as f32);
        let mut sum = [0.0; 4];
        for corner in 0..8usize {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight = (0..3).fold(1.0, |weight, axis| {
                weight * if up[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] }
            });
            let values = match leaf {
                Some(leaf) => leaf[((x + up[0]) * SIDE + y + up[1]) * SIDE + z + up[2]],
                None => self.point(std::array::from_fn(|axis| cell[axis] + up[axis] as i64)),
            };
            for (sum, value) in sum.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
        Some(sum)
    }

    fn density_of(&self, value: f32) -> f32 {
        match self.extinction {
            Extinction::Density => value.max(0.0),
            Extinction::Opacity(length) => {
                -libm::logf((1.0 - value).clamp(CLEAREST, 1.0)) / length as f32
            }
        }
    }

    fn place(&self, world: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| (world[axis] - self.first[axis]) / self.spacing[axis])
    }
}

impl TrainedModel for VolumeModel {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let start = self.place(ray.origin.to_array());
        let mut along = unit_direction(ray);
        along.iter_mut().zip(self.spacing).for_each(|(by, spacing)| *by /= spacing);
        let step = self.spacing.into_iter().fold(f64::INFINITY, f64::min) / SAMPLES;
        let corners = [0, 1].map(|side| self.faces.map(|faces| faces[side]));
        let guard = ZeroGuard::Replace(f64::MIN_POSITIVE);
        let [enters, leaves] = crossing(start, along, corners, guard);
        let from = enters.max(f64::from(rules.near) * ray.direction.length());
        let mut light = DepthComposite::default();
        // No sample lies on the face itself.
        let steps = Steps { start: from, step, end: leaves.next_down() };
        steps.walk(0.5, progress, |t| {
            let place = point_at(start, along, t);
            let Some([value, rgb @ ..]) = self.at(place) else {
                return Next::Number(self.leaves_at(place, along, t, from, step));
            };
            let depth = f64::from(self.density_of(value)) * step;
            if depth > 0.0 {
                light.add(depth, t, rgb.map(f64::from));
            }
            if light.depth < OPAQUE { Next::Step } else { Next::End }
        });
        let behind = RayRules {
            background: rules.background.map(|value| linear(value.into()) as f32),
            ..*rules
        };
        let color = over_background(light.color(), light.transmittance(), &behind);
        ray_color(color.map(display), light.transmittance(), light.distance, rules)
    }

    fn density(&self, position: [f64; 3]) -> f32 {
        self.at(self.place(position)).map_or(0.0, |[value, ..]| self.density_of(value))
    }

    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let [_, rgb @ ..] = self.at(self.place(position)).unwrap_or_default();
        vec![rgb.map(|value| display(value.into()) as f32); directions.len()]
    }
}

impl VolumeModel {
    /// The number of the first sample behind the empty leaf of a place.
    fn leaves_at(&self, place: [f64; 3], along: [f64; 3], t: f64, from: f64, step: f64) -> f64 {
        let side = SIDE as f64;
        let exit = (0..3).fold(f64::INFINITY, |exit, axis| {
            let low = (place[axis] / side).floor() * side;
            let face = if along[axis] > 0.0 { low + side } else { low };
            let until = (face - place[axis]) / along[axis];
            if along[axis] == 0.0 { exit } else { exit.min(until.max(0.0)) }
        });
        ((t + exit - from) / step - 0.5).ceil() + 0.5
    }
}
