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
/// Points along the edge of a leaf and its apron on the upper sides.
const APRON: usize = SIDE + 1;
/// Marks places without a leaf.
const NO_LEAF: u32 = u32::MAX;

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
    /// Leaf of each place, or [`NO_LEAF`].
    table: Vec<u32>,
    /// Leaves with aprons.
    values: Vec<[f32; 4]>,
}

impl VolumeModel {
    /// Gives each leaf an apron.
    ///
    /// # Errors
    ///
    /// More memory than the limits allow.
    pub fn new(points: &VolumePoints, limits: &Limits) -> Result<Self> {
        // A cell belongs to the leaf of its lowest point.
        let mut owners: Vec<[i32; 3]> = Vec::new();
        for at in points.leaves.keys() {
            owners.extend((0..8).map(|corner| {
                let down = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                std::array::from_fn(|axis| at[axis] - down[axis])
            }));
        }
        owners.sort_unstable();
        owners.dedup();
        let lowest = [0, 1, 2].map(|a| owners.iter().map(|at| at[a]).min().unwrap_or(0));
        let highest = [0, 1, 2].map(|a| owners.iter().map(|at| at[a]).max().unwrap_or(-1));
        let counts: [usize; 3] =
            std::array::from_fn(|axis| (highest[axis] - lowest[axis] + 1).max(0) as usize);
        let mut budget = Budget::new(limits);
        let what = "bytes of a volume's table";
        let places = counts.iter().try_fold(1usize, |n, &count| n.checked_mul(count));
        let mut table: Vec<u32> =
            budget.zeroed(places.unwrap_or(usize::MAX), what, &Place::File)?;
        table.fill(NO_LEAF);
        let length = APRON.pow(3);
        let mut values: Vec<[f32; 4]> =
            budget.zeroed(owners.len() * length, "bytes of a volume", &Place::File)?;
        for (number, (at, values)) in owners.iter().zip(values.chunks_exact_mut(length)).enumerate()
        {
            let [x, y, z] = std::array::from_fn(|axis| (at[axis] - lowest[axis]) as usize);
            table[(x * counts[1] + y) * counts[2] + z] = number as u32;
            fill(points, *at, values);
        }
        let (first, spacing, extinction) = (points.first, points.spacing, points.extinction);
        let leaves = [0, 1, 2].map(|axis| {
            let low = f64::from(lowest[axis]) * SIDE as f64;
            [low, low + (counts[axis] * SIDE) as f64]
        });
        let faces = points.faces.unwrap_or(leaves);
        Ok(Self { first, spacing, extinction, lowest, counts, faces, table, values })
    }

    /// The values of the leaf that owns a cell, and the cell in it.
    fn leaf(&self, cell: [i64; 3]) -> Option<(&[[f32; 4]], [usize; 3])> {
        let side = SIDE as i64;
        let mut place = [0; 3];
        for axis in 0..3 {
            let at = cell[axis].div_euclid(side) - i64::from(self.lowest[axis]);
            place[axis] = usize::try_from(at).ok().filter(|&at| at < self.counts[axis])?;
        }
        let at = (place[0] * self.counts[1] + place[1]) * self.counts[2] + place[2];
        let number = self.table[at];
        let length = APRON.pow(3);
        let values = self.values.get(number as usize * length..)?.get(..length)?;
        Some((values, cell.map(|cell| cell.rem_euclid(side) as usize)))
    }

    /// Interpolated values at a place, in distances of points.
    fn at(&self, place: [f64; 3]) -> Option<[f32; 4]> {
        let low = place.map(|at| at.floor());
        let (values, [x, y, z]) = self.leaf(low.map(|at| at as i64))?;
        let fraction: [f32; 3] = std::array::from_fn(|axis| (place[axis] - low[axis]) as f32);
        let mut sum = [0.0; 4];
        for corner in 0..8usize {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight = (0..3).fold(1.0, |weight, axis| {
                weight * if up[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] }
            });
            let node = ((x + up[0]) * APRON + y + up[1]) * APRON + z + up[2];
            for (sum, value) in sum.iter_mut().zip(values[node]) {
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

/// Copies the values of a leaf and of its upper neighbours.
fn fill(points: &VolumePoints, at: [i32; 3], out: &mut [[f32; 4]]) {
    for corner in 0..8usize {
        let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let neighbour: [i32; 3] = std::array::from_fn(|axis| at[axis] + up[axis] as i32);
        let Some(values) = points.leaves.get(&neighbour) else { continue };
        // Of neighbours, the points on the side of the leaf.
        let [nx, ny, nz] = up.map(|up| if up == 1 { 1 } else { SIDE });
        let [fx, fy, fz] = up.map(|up| up * SIDE);
        for (x, y) in (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y))) {
            let from = (x * SIDE + y) * SIDE;
            let to = ((x + fx) * APRON + y + fy) * APRON + fz;
            out[to..to + nz].copy_from_slice(&values[from..from + nz]);
        }
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
