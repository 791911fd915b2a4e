//! The samples of a ray on a grid in memory, and the light that they add up to.

use super::loaded::{Cell, LoadedRows};
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::trained_model::{RayColor, RayRules, Samples};

/// Samples no farther beyond a face than this, in nodes, lie on it.
const ON_FACE: f64 = 1e-9;

/// A map from the world to positions in nodes: node 0 is at 0.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    /// World position of node 0.
    pub origin: [f64; 3],
    /// Nodes for a world unit.
    pub per_unit: [f64; 3],
    /// The box in which samples are taken, in nodes along each axis.
    pub faces: [[f64; 2]; 3],
}

/// The part of a ray in a box. Distances are world units along the ray.
#[derive(Debug, Clone, Copy)]
pub struct GridPath {
    origin: [f64; 3],
    /// Nodes for a world unit along the ray.
    pub direction: [f64; 3],
    start: f64,
    end: f64,
}

impl Lattice {
    /// A world position in nodes.
    pub fn to_nodes(&self, world: [f64; 3]) -> [f64; 3] {
        let mut nodes = world;
        let axes = self.origin.into_iter().zip(self.per_unit);
        nodes.iter_mut().zip(axes).for_each(|(at, (origin, by))| *at = (*at - origin) * by);
        nodes
    }

    /// True for positions in the box, in nodes.
    pub fn contains(&self, nodes: [f64; 3]) -> bool {
        let inside = |(at, [low, high]): (f64, [f64; 2])| (low..=high).contains(&at);
        nodes.into_iter().zip(self.faces).all(inside)
    }

    /// The part of a ray in the box; none if it misses it.
    pub fn path(&self, ray: &Ray, rules: &RayRules) -> Option<GridPath> {
        let mut direction = (ray.direction / ray.direction.length()).to_array();
        direction.iter_mut().zip(self.per_unit).for_each(|(step, by)| *step *= by);
        let origin = self.to_nodes(ray.origin.to_array());
        let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
        for ((from, by), [low, high]) in origin.into_iter().zip(direction).zip(self.faces) {
            if by == 0.0 {
                if !(low - ON_FACE..=high + ON_FACE).contains(&from) {
                    return None;
                }
                continue;
            }
            let [a, b] = [(low - from) / by, (high - from) / by];
            (start, end) = (start.max(a.min(b)), end.min(a.max(b) + ON_FACE / by.abs()));
        }
        let far = rules.far.map_or(f64::INFINITY, f64::from);
        start = start.max(f64::from(rules.near)).min(far);
        (start <= end).then_some(GridPath { origin, direction, start, end })
    }
}

impl GridPath {
    /// Visits samples front to back, `step` world units from one to the next, with their distance
    /// and cell, until a visit says no. Where no density is above 0, samples are left out. So are
    /// those beyond the most that any ray may have.
    pub fn walk(
        &self,
        rows: &LoadedRows,
        step: f64,
        progress: &dyn Progress,
        mut visit: impl FnMut(f64, &Cell) -> bool,
    ) {
        let mut number = 0.0f64;
        let mut samples = Samples::new(self.start, step, progress);
        while samples.take() {
            let t = self.start + number * step;
            if t > self.end {
                return;
            }
            let at = rows.clamped(self.position(t));
            if rows.is_empty(at) {
                // Whole steps, so that samples keep their places.
                let leaves = self.leaves(rows.cube_faces(at));
                number = ((leaves - self.start) / step).floor().max(number + 1.0);
                continue;
            }
            if !visit(t, &rows.cell(at)) {
                return;
            }
            number += 1.0;
        }
    }

    /// True if the sample at this distance is the ray's last one.
    pub fn is_last(&self, t: f64, step: f64) -> bool {
        t + step > self.end
    }

    fn position(&self, t: f64) -> [f64; 3] {
        let mut position = self.origin;
        position.iter_mut().zip(self.direction).for_each(|(at, by)| *at += t * by);
        position
    }

    /// The distance at which the ray leaves a box.
    fn leaves(&self, faces: [[f64; 2]; 3]) -> f64 {
        let axes = self.origin.into_iter().zip(self.direction).zip(faces);
        let exits = axes.map(|((from, by), [low, high])| match by {
            0.0 => f64::INFINITY,
            _ => ((low - from) / by).max((high - from) / by),
        });
        exits.fold(f64::INFINITY, f64::min)
    }
}

/// The light of a ray while it is followed, front to back.
#[derive(Debug, Clone, Copy, Default)]
pub struct Light {
    /// Optical depth so far.
    pub depth: f64,
    color: [f64; 3],
    distance: f64,
}

impl Light {
    /// Adds a sample of an optical depth and a colour at a distance.
    pub fn add(&mut self, depth: f64, at: f64, seen: [f64; 3]) {
        let weight = -libm::exp(-self.depth) * libm::expm1(-depth);
        self.color.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += weight * seen);
        self.distance += weight * at;
        self.depth += depth;
    }

    /// The light left behind all that was added.
    pub fn transmittance(&self) -> f64 {
        libm::exp(-self.depth)
    }

    /// The light over the background.
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    pub fn over_background(&self, rules: &RayRules) -> RayColor {
        let left = self.transmittance();
        let mut color = rules.background;
        for (value, sum) in color.iter_mut().zip(self.color) {
            *value = (sum + left * f64::from(*value)) as f32;
        }
        let far = f64::from(rules.far.unwrap_or(0.0));
        let distance = (self.distance + left * far) as f32;
        RayColor { color, transmittance: left as f32, distance }
    }
}
