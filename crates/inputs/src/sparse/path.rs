//! The samples of a ray on a grid in memory.

use super::loaded::{Cell, LoadedRows};
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{Next, Steps, point_at, unit_direction};
use crate::model::trained_model::RayRules;

/// Samples at most this far beyond a face, in nodes, lie on it.
const ON_FACE: f64 = 1e-9;

/// A map from the world to positions in nodes; node 0 is at 0.
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
        let mut direction = unit_direction(ray);
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
        start = start.max(f64::from(rules.near)).min(rules.farthest());
        (start <= end).then_some(GridPath { origin, direction, start, end })
    }
}

impl GridPath {
    /// Visits samples front to back, `step` world units apart, with their distance and cell, until
    /// a visit returns false or the limit of samples is reached. Samples without density above 0
    /// are skipped.
    pub fn walk(
        &self,
        rows: &LoadedRows,
        step: f64,
        progress: &dyn Progress,
        mut visit: impl FnMut(f64, &Cell) -> bool,
    ) {
        let steps = Steps { start: self.start, step, end: self.end };
        steps.walk(0.0, progress, |t| {
            let at = rows.clamped(point_at(self.origin, self.direction, t));
            if rows.is_empty(at) {
                // Whole steps, so that samples keep their places.
                return Next::Number(steps.number_before(self.leaves(rows.cube_faces(at))));
            }
            if visit(t, &rows.cell(at)) { Next::Step } else { Next::End }
        });
    }

    /// True if the sample at this distance is the ray's last one.
    pub fn is_last(&self, t: f64, step: f64) -> bool {
        t + step > self.end
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
