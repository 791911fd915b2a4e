//! Fewer triangles: edges collapse, the one with the least loss first (Garland and Heckbert 1997).
//!
//! A vertex carries a quadric, `Q(x) = x' A x + 2 b' x + c`: the sum, over the planes of its triangles, of
//! area times squared distance, and a small share of the squared distance to the vertex itself, which
//! keeps flat regions where they are and `A` invertible. The merged vertex lies where the sum of both
//! quadrics is least. To that loss comes what the merged colour loses, a difference of 1 counting like a
//! displacement by a cell.
//!
//! Collapses that would turn a triangle over or pinch the surface wait until no others are left.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use super::triangles::Draft;
use super::vector::{cross, dot, length, minus};

/// Weight of the distance to the vertex itself, of that to its planes.
const OWN_SHARE: f64 = 1e-3;
/// Cosine of the angle by which a triangle may turn in one collapse.
const LEAST_TURN: f64 = 0.2;

/// At most `most` triangles of what `draft` holds; `cell` is the unit in which colours count.
pub fn simplify(draft: Draft, most: usize, cell: f64) -> Draft {
    let mut surface = Surface::new(draft, cell);
    for careful in [true, false] {
        surface.collapse(most, careful);
    }
    surface.finish()
}

/// `x' A x + 2 b' x + c`, `A` symmetric: xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, Default)]
struct Quadric {
    a: [f64; 6],
    b: [f64; 3],
    c: f64,
}

impl Quadric {
    fn plus(&self, other: &Self) -> Self {
        Self {
            a: std::array::from_fn(|i| self.a[i] + other.a[i]),
            b: std::array::from_fn(|i| self.b[i] + other.b[i]),
            c: self.c + other.c,
        }
    }

    /// Weighted squared distance to the plane through `point` with this unit normal.
    fn plane(normal: [f64; 3], point: [f64; 3], weight: f64) -> Self {
        let [x, y, z] = normal;
        let d = -dot(normal, point);
        Self {
            a: [x * x, x * y, x * z, y * y, y * z, z * z].map(|value| weight * value),
            b: normal.map(|value| weight * d * value),
            c: weight * d * d,
        }
    }

    /// Weighted squared distance to a point.
    fn point(point: [f64; 3], weight: f64) -> Self {
        Self {
            a: [weight, 0.0, 0.0, weight, 0.0, weight],
            b: point.map(|value| -weight * value),
            c: weight * dot(point, point),
        }
    }

    fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let squares = xx * x * x + yy * y * y + zz * z * z;
        let products = xy * x * y + xz * x * z + yz * y * z;
        squares + 2.0 * (products + dot(self.b, [x, y, z])) + self.c
    }

    /// Where it is least, by Cramer's rule; none where rounding leaves no answer.
    fn least(&self) -> Option<[f64; 3]> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let determinant = dot(rows[0], cross(rows[1], rows[2]));
        let right = self.b.map(|value| -value);
        // The inverse of a symmetric matrix: its rows' cross products over the determinant.
        let inverse = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])];
        let found = inverse.map(|row| dot(row, right) / determinant);
        (determinant > 0.0 && found.iter().all(|value| value.is_finite())).then_some(found)
    }
}

/// A pair of vertices that share an edge, and what merging them would lose.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    loss: f64,
    pair: [u32; 2],
    /// Changes of both vertices when the loss was computed.
    changes: [u32; 2],
    to: [f64; 3],
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let order = self.loss.total_cmp(&other.loss).then(self.pair.cmp(&other.pair));
        order.then(self.changes.cmp(&other.changes))
    }
}

struct Surface {
    draft: Draft,
    /// Triangles of each vertex; empty once it was merged into another.
    around: Vec<Vec<u32>>,
    /// By triangle; false once it is gone.
    alive: Vec<bool>,
    count: usize,
    quadrics: Vec<Quadric>,
    /// Area that each vertex stands for: the weight of its colour.
    weights: Vec<f64>,
    changes: Vec<u32>,
    /// Squared.
    cell: f64,
    /// The first position, taken from all others to keep digits.
    origin: [f64; 3],
    /// Lowest and highest coordinates: no merged vertex leaves the box of the surface.
    extent: [[f64; 3]; 2],
}

impl Surface {
    fn new(mut draft: Draft, cell: f64) -> Self {
        let origin = draft.positions.first().copied().unwrap_or_default();
        draft.positions.iter_mut().for_each(|position| *position = minus(*position, origin));
        let bound = |pick: fn(f64, f64) -> f64| {
            let join = |a: [f64; 3], b: &[f64; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
            draft.positions.iter().fold([0.0; 3], join)
        };
        let extent = [bound(f64::min), bound(f64::max)];
        let vertices = draft.positions.len();
        let mut surface = Self {
            around: vec![Vec::new(); vertices],
            alive: vec![true; draft.triangles.len()],
            count: draft.triangles.len(),
            quadrics: vec![Quadric::default(); vertices],
            weights: vec![0.0; vertices],
            changes: vec![0; vertices],
            cell: cell * cell,
            origin,
            extent,
            draft,
        };
        for (number, corners) in surface.draft.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|corner| surface.draft.positions[corner as usize]);
            let normal = cross(minus(b, a), minus(c, a));
            let twice = length(normal);
            for &corner in corners {
                let corner = corner as usize;
                surface.around[corner].push(number as u32);
                if twice > 0.0 {
                    let area = twice / 6.0;
                    let plane = Quadric::plane(normal.map(|n| n / twice), a, area);
                    let own = surface.draft.positions[corner];
                    let point = Quadric::point(own, OWN_SHARE * area);
                    let quadric = surface.quadrics[corner].plus(&plane).plus(&point);
                    surface.quadrics[corner] = quadric;
                    surface.weights[corner] += area;
                }
            }
        }
        surface
    }

    /// Collapses edges until at most `most` triangles are left, or no candidate is.
    fn collapse(&mut self, most: usize, careful: bool) {
        let mut heap = BinaryHeap::new();
        if self.count > most {
            for vertex in 0..self.around.len() as u32 {
                let others = self.neighbours(vertex).into_iter().filter(|other| *other > vertex);
                heap.extend(others.map(|other| Reverse(self.candidate(vertex, other))));
            }
        }
        while let Some(Reverse(candidate)) = heap.pop() {
            if self.count <= most {
                break;
            }
            let current = candidate.pair.map(|vertex| self.changes[vertex as usize]);
            if current != candidate.changes || (careful && !self.is_harmless(&candidate)) {
                continue;
            }
            let [kept, _] = candidate.pair;
            self.merge(&candidate);
            for other in self.neighbours(kept) {
                heap.push(Reverse(self.candidate(kept.min(other), kept.max(other))));
            }
        }
    }

    /// The other corners of a vertex's triangles, each once, in the order of their numbers.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let triangles = self.around[vertex as usize].iter();
        let corners = triangles.flat_map(|&triangle| self.draft.triangles[triangle as usize]);
        let mut others: Vec<u32> = corners.filter(|&corner| corner != vertex).collect();
        others.sort_unstable();
        others.dedup();
        others
    }

    fn candidate(&self, low: u32, high: u32) -> Candidate {
        let [a, b] = [low as usize, high as usize];
        let quadric = self.quadrics[a].plus(&self.quadrics[b]);
        let [from, to] = [self.draft.positions[a], self.draft.positions[b]];
        let middle = std::array::from_fn(|axis| 0.5 * (from[axis] + to[axis]));
        let to = quadric.least().unwrap_or(middle);
        let [lowest, highest] = self.extent;
        let to = std::array::from_fn(|axis| to[axis].clamp(lowest[axis], highest[axis]));
        let colors = minus(self.draft.colors[a], self.draft.colors[b]);
        let (wa, wb) = (self.weights[a], self.weights[b]);
        let mean = if wa + wb > 0.0 { wa * wb / (wa + wb) } else { 0.0 };
        let loss = quadric.at(to).max(0.0) + self.cell * mean * dot(colors, colors);
        Candidate { loss, pair: [low, high], changes: [self.changes[a], self.changes[b]], to }
    }

    /// Whether no triangle turns over, and the surface around the edge stays a surface: the vertices
    /// that both ends are joined to are the third corners of the edge's two triangles.
    fn is_harmless(&self, candidate: &Candidate) -> bool {
        let [a, b] = candidate.pair;
        let (near, far) = (self.neighbours(a), self.neighbours(b));
        let common = near.iter().filter(|vertex| far.binary_search(vertex).is_ok()).count();
        let shared = self.around[a as usize].iter();
        let shared = shared.filter(|&&t| self.draft.triangles[t as usize].contains(&b)).count();
        if common != 2 || shared != 2 {
            return false;
        }
        let own = [a, b].into_iter().flat_map(|vertex| &self.around[vertex as usize]);
        own.map(|&triangle| self.draft.triangles[triangle as usize])
            .filter(|corners| !(corners.contains(&a) && corners.contains(&b)))
            .all(|corners| {
                let old = corners.map(|corner| self.draft.positions[corner as usize]);
                let mut new = old;
                for (position, corner) in new.iter_mut().zip(corners) {
                    if corner == a || corner == b {
                        *position = candidate.to;
                    }
                }
                let [before, after] = [old, new].map(|[p, q, r]| cross(minus(q, p), minus(r, p)));
                dot(before, after) > LEAST_TURN * length(before) * length(after)
            })
    }

    fn merge(&mut self, candidate: &Candidate) {
        let [kept, gone] = candidate.pair.map(|vertex| vertex as usize);
        let (wa, wb) = (self.weights[kept], self.weights[gone]);
        if wa + wb > 0.0 {
            let [a, b] = [self.draft.colors[kept], self.draft.colors[gone]];
            self.draft.colors[kept] = std::array::from_fn(|i| (wa * a[i] + wb * b[i]) / (wa + wb));
        }
        self.weights[kept] = wa + wb;
        self.quadrics[kept] = self.quadrics[kept].plus(&self.quadrics[gone]);
        self.draft.positions[kept] = candidate.to;
        self.changes[kept] += 1;
        self.changes[gone] += 1;
        for triangle in std::mem::take(&mut self.around[gone]) {
            let corners = &mut self.draft.triangles[triangle as usize];
            if corners.contains(&candidate.pair[0]) {
                self.remove(triangle);
                continue;
            }
            for corner in corners.iter_mut().filter(|corner| **corner as usize == gone) {
                *corner = candidate.pair[0];
            }
            let corners = *corners;
            match self.twin(kept, corners) {
                // Both sides of nothing.
                Some((twin, true)) => [triangle, twin].into_iter().for_each(|t| self.remove(t)),
                Some((_, false)) => self.remove(triangle),
                None => self.around[kept].push(triangle),
            }
        }
    }

    /// A triangle around a vertex with the same corners, and whether it faces the other way.
    fn twin(&self, vertex: usize, corners: [u32; 3]) -> Option<(u32, bool)> {
        let [a, b, c] = corners;
        let same = [[a, b, c], [b, c, a], [c, a, b]];
        let turned = [[a, c, b], [c, b, a], [b, a, c]];
        self.around[vertex].iter().find_map(|&other| {
            let corners = self.draft.triangles[other as usize];
            let faces_away = turned.contains(&corners);
            (faces_away || same.contains(&corners)).then_some((other, faces_away))
        })
    }

    fn remove(&mut self, triangle: u32) {
        if std::mem::replace(&mut self.alive[triangle as usize], false) {
            self.count -= 1;
        }
        for corner in self.draft.triangles[triangle as usize] {
            self.around[corner as usize].retain(|&other| other != triangle);
        }
    }

    fn finish(mut self) -> Draft {
        let mut alive = self.alive.iter();
        self.draft.triangles.retain(|_| alive.next() == Some(&true));
        let origin = self.origin;
        for position in &mut self.draft.positions {
            *position = std::array::from_fn(|axis| position[axis] + origin[axis]);
        }
        self.draft
    }
}
