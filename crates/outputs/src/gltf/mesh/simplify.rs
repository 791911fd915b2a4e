//! Fewer triangles: edges collapse, the one with the least loss first (Garland and Heckbert 1997).
//!
//! A vertex carries a quadric, `Q(x) = x' A x + 2 b' x + c`: the sum, over the planes of its
//! triangles, of area times squared distance, and a small share of the squared distance to the
//! vertex itself, which keeps vertices of flat regions in place and `A` invertible. The merged
//! vertex lies at the minimum of the sum of both quadrics. The loss of the merged colour is added;
//! a difference of 1 counts like a displacement by a cell.
//!
//! Collapses that would flip a triangle or pinch the surface wait until no others are left.
//!
//! Extents start at +0 and take a coordinate only if it is strictly beyond: of two zeros,
//! `f64::min` and `f64::max` may return either, depending on the machine.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::triangles::TriangleSoup;
use super::vector::{cross, dot, length, minus};

/// Weight of the distance to the vertex itself, relative to that to its planes.
const OWN_SHARE: f64 = 1e-3;
/// Cosine of the maximum rotation of a triangle in one collapse.
const LEAST_TURN: f64 = 0.2;

/// At most `max_triangles` triangles made from `soup`; `cell` is the unit in which colours count.
pub fn simplify(soup: TriangleSoup, max_triangles: usize, cell: f64) -> TriangleSoup {
    let mut surface = Surface::new(soup, cell);
    for careful in [true, false] {
        surface.collapse(max_triangles, careful);
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

    /// The place of its least value, by Cramer's rule; none if rounding leaves no answer.
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

/// The collapse of an edge, ordered by execution. The queue holds millions, so it is small: the
/// merged vertex is recomputed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct EdgeCollapse {
    /// The bits of the loss of merging the two vertices: non-negative floats sort like their bits.
    loss: u64,
    /// The vertices, the lower number first.
    pair: [u32; 2],
    /// Changes of both when the loss was computed.
    changes: [u32; 2],
}

/// Collapses in the order of their loss. Those beyond a bound are rarely reached and stay unsorted,
/// because a heap of all of them would not fit into the caches.
struct Queue {
    /// Initial collapses, sorted from the end.
    sorted: Vec<EdgeCollapse>,
    /// Later collapses.
    heap: BinaryHeap<Reverse<EdgeCollapse>>,
    /// The largest loss in `sorted` and in `heap`.
    bound: u64,
    waiting: Vec<EdgeCollapse>,
}

impl Queue {
    /// For edges, with the expected number of collapses.
    fn new(mut edges: Vec<EdgeCollapse>, likely: usize) -> Self {
        edges.sort_unstable();
        let bound = edges.get(likely).map_or(u64::MAX, |edge| edge.loss);
        let waiting = edges.split_off(edges.partition_point(|edge| edge.loss <= bound));
        edges.reverse();
        Self { sorted: edges, heap: BinaryHeap::new(), bound, waiting }
    }

    fn push(&mut self, edge: EdgeCollapse) {
        match edge.loss <= self.bound {
            true => self.heap.push(Reverse(edge)),
            false => self.waiting.push(edge),
        }
    }

    fn pop(&mut self) -> Option<EdgeCollapse> {
        if self.sorted.is_empty() && self.heap.is_empty() {
            self.bound = u64::MAX;
            self.sorted = std::mem::take(&mut self.waiting);
            self.sorted.sort_unstable_by(|a, b| b.cmp(a));
        }
        match (self.sorted.last(), self.heap.peek()) {
            (Some(first), Some(Reverse(later))) if later < first => {
                self.heap.pop().map(|Reverse(edge)| edge)
            }
            (Some(_), _) => self.sorted.pop(),
            (None, _) => self.heap.pop().map(|Reverse(edge)| edge),
        }
    }
}

struct Surface {
    soup: TriangleSoup,
    /// Triangles of each vertex; empty once it was merged into another.
    around: Vec<Vec<u32>>,
    /// By triangle; false once it is gone.
    alive: Vec<bool>,
    count: usize,
    quadrics: Vec<Quadric>,
    /// Area of each vertex: the weight of its colour.
    weights: Vec<f64>,
    changes: Vec<u32>,
    /// Squared.
    cell: f64,
    /// The first position, subtracted from all others for precision.
    origin: [f64; 3],
    /// Lowest and highest coordinates; merged vertices stay in this box.
    extent: [[f64; 3]; 2],
}

impl Surface {
    fn new(mut soup: TriangleSoup, cell: f64) -> Self {
        let origin = soup.positions.first().copied().unwrap_or_default();
        soup.positions.iter_mut().for_each(|position| *position = minus(*position, origin));
        let bound = |pick: fn(f64, f64) -> f64| {
            let join = |a: [f64; 3], b: &[f64; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
            soup.positions.iter().fold([0.0; 3], join)
        };
        let extent =
            [bound(|a, b| if b < a { b } else { a }), bound(|a, b| if b > a { b } else { a })];
        let vertices = soup.positions.len();
        let mut surface = Self {
            around: (0..vertices).map(|_| Vec::with_capacity(8)).collect(),
            alive: vec![true; soup.triangles.len()],
            count: soup.triangles.len(),
            quadrics: vec![Quadric::default(); vertices],
            weights: vec![0.0; vertices],
            changes: vec![0; vertices],
            cell: cell * cell,
            origin,
            extent,
            soup,
        };
        for (number, corners) in surface.soup.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|corner| surface.soup.positions[corner as usize]);
            let normal = cross(minus(b, a), minus(c, a));
            let twice = length(normal);
            for &corner in corners {
                let corner = corner as usize;
                surface.around[corner].push(number as u32);
                if twice > 0.0 {
                    let area = twice / 6.0;
                    let plane = Quadric::plane(normal.map(|n| n / twice), a, area);
                    let own = surface.soup.positions[corner];
                    let point = Quadric::point(own, OWN_SHARE * area);
                    let quadric = surface.quadrics[corner].plus(&plane).plus(&point);
                    surface.quadrics[corner] = quadric;
                    surface.weights[corner] += area;
                }
            }
        }
        surface
    }

    /// Collapses edges until at most `most` triangles are left, or no edge can.
    fn collapse(&mut self, max_triangles: usize, careful: bool) {
        if self.count <= max_triangles {
            return;
        }
        let mut edges = Vec::new();
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for vertex in 0..self.around.len() as u32 {
            self.neighbours(vertex, &mut near);
            let others = near.iter().filter(|other| **other > vertex);
            edges.extend(others.map(|&other| self.edge_collapse(vertex, other)));
        }
        // A collapse removes two triangles, and makes other collapses possible.
        let likely = self.count - max_triangles;
        let mut queue = Queue::new(edges, likely);
        while let Some(edge) = queue.pop() {
            let current = edge.pair.map(|vertex| self.changes[vertex as usize]);
            if current != edge.changes {
                continue;
            }
            let to = self.merged(edge.pair);
            if careful && !self.is_harmless(edge.pair, to, [&mut near, &mut far]) {
                continue;
            }
            let [kept, _] = edge.pair;
            self.merge(edge.pair, to);
            if self.count <= max_triangles {
                break;
            }
            self.neighbours(kept, &mut near);
            for &other in &near {
                queue.push(self.edge_collapse(kept.min(other), kept.max(other)));
            }
        }
    }

    /// The other corners of a vertex's triangles, each once, in the order of their numbers.
    /// `others` is cleared first: a new list per collapse would take a tenth of the time.
    fn neighbours(&self, vertex: u32, others: &mut Vec<u32>) {
        others.clear();
        for &triangle in &self.around[vertex as usize] {
            let corners = self.soup.triangles[triangle as usize];
            others.extend(corners.into_iter().filter(|&corner| corner != vertex));
        }
        others.sort_unstable();
        others.dedup();
    }

    /// The sum of two vertices' quadrics.
    fn quadric(&self, pair: [u32; 2]) -> Quadric {
        let [a, b] = pair.map(|vertex| &self.quadrics[vertex as usize]);
        a.plus(b)
    }

    /// The position of the merged vertex of two vertices.
    fn merged(&self, pair: [u32; 2]) -> [f64; 3] {
        let to = self.quadric(pair).least().unwrap_or_else(|| {
            let [from, to] = pair.map(|vertex| self.soup.positions[vertex as usize]);
            std::array::from_fn(|axis| 0.5 * (from[axis] + to[axis]))
        });
        let [lowest, highest] = self.extent;
        std::array::from_fn(|axis| to[axis].clamp(lowest[axis], highest[axis]))
    }

    fn edge_collapse(&self, low: u32, high: u32) -> EdgeCollapse {
        let [a, b] = [low as usize, high as usize];
        let error = self.quadric([low, high]).at(self.merged([low, high]));
        let colors = minus(self.soup.colors[a], self.soup.colors[b]);
        let (wa, wb) = (self.weights[a], self.weights[b]);
        let mean = if wa + wb > 0.0 { wa * wb / (wa + wb) } else { 0.0 };
        let error = if error > 0.0 { error } else { 0.0 };
        let loss = error + self.cell * mean * dot(colors, colors);
        let changes = [self.changes[a], self.changes[b]];
        EdgeCollapse { loss: loss.to_bits(), pair: [low, high], changes }
    }

    /// True if no triangle flips and the surface stays a manifold: the common neighbours of both
    /// ends are the third corners of the edge's two triangles.
    fn is_harmless(&self, [a, b]: [u32; 2], to: [f64; 3], [near, far]: [&mut Vec<u32>; 2]) -> bool {
        self.neighbours(a, near);
        self.neighbours(b, far);
        let common = near.iter().filter(|vertex| far.binary_search(vertex).is_ok()).count();
        let shared = self.around[a as usize].iter();
        let shared = shared.filter(|&&t| self.soup.triangles[t as usize].contains(&b)).count();
        if common != 2 || shared != 2 {
            return false;
        }
        let own = [a, b].into_iter().flat_map(|vertex| &self.around[vertex as usize]);
        own.map(|&triangle| self.soup.triangles[triangle as usize])
            .filter(|corners| !(corners.contains(&a) && corners.contains(&b)))
            .all(|corners| {
                let old = corners.map(|corner| self.soup.positions[corner as usize]);
                let mut new = old;
                for (position, corner) in new.iter_mut().zip(corners) {
                    if corner == a || corner == b {
                        *position = to;
                    }
                }
                let [before, after] = [old, new].map(|[p, q, r]| cross(minus(q, p), minus(r, p)));
                dot(before, after) > LEAST_TURN * length(before) * length(after)
            })
    }

    fn merge(&mut self, pair: [u32; 2], to: [f64; 3]) {
        let [kept, gone] = pair.map(|vertex| vertex as usize);
        let (wa, wb) = (self.weights[kept], self.weights[gone]);
        if wa + wb > 0.0 {
            let [a, b] = [self.soup.colors[kept], self.soup.colors[gone]];
            self.soup.colors[kept] = std::array::from_fn(|i| (wa * a[i] + wb * b[i]) / (wa + wb));
        }
        self.weights[kept] = wa + wb;
        self.quadrics[kept] = self.quadrics[kept].plus(&self.quadrics[gone]);
        self.soup.positions[kept] = to;
        self.changes[kept] += 1;
        self.changes[gone] += 1;
        for triangle in std::mem::take(&mut self.around[gone]) {
            let corners = &mut self.soup.triangles[triangle as usize];
            if corners.contains(&pair[0]) {
                self.remove(triangle);
                continue;
            }
            for corner in corners.iter_mut().filter(|corner| **corner as usize == gone) {
                *corner = pair[0];
            }
            let corners = *corners;
            match self.twin(kept, corners) {
                // Both sides of an empty region.
                Some((twin, true)) => [triangle, twin].into_iter().for_each(|t| self.remove(t)),
                Some((_, false)) => self.remove(triangle),
                None => self.around[kept].push(triangle),
            }
        }
    }

    /// A triangle of a vertex with the same corners, and whether it faces the opposite direction.
    fn twin(&self, vertex: usize, corners: [u32; 3]) -> Option<(u32, bool)> {
        let [a, b, c] = corners;
        let same = [[a, b, c], [b, c, a], [c, a, b]];
        let turned = [[a, c, b], [c, b, a], [b, a, c]];
        self.around[vertex].iter().find_map(|&other| {
            let corners = self.soup.triangles[other as usize];
            let faces_away = turned.contains(&corners);
            (faces_away || same.contains(&corners)).then_some((other, faces_away))
        })
    }

    fn remove(&mut self, triangle: u32) {
        if std::mem::replace(&mut self.alive[triangle as usize], false) {
            self.count -= 1;
        }
        for corner in self.soup.triangles[triangle as usize] {
            self.around[corner as usize].retain(|&other| other != triangle);
        }
    }

    /// The remaining surface, without merged vertices.
    fn finish(mut self) -> TriangleSoup {
        let mut alive = self.alive.iter();
        self.soup.triangles.retain(|_| alive.next() == Some(&true));
        let mut numbers = vec![u32::MAX; self.soup.positions.len()];
        let mut left = TriangleSoup::default();
        for corner in self.soup.triangles.as_flattened() {
            let number = &mut numbers[*corner as usize];
            if *number == u32::MAX {
                *number = left.positions.len() as u32;
                let position = self.soup.positions[*corner as usize];
                left.positions.push(std::array::from_fn(|axis| position[axis] + self.origin[axis]));
                left.colors.push(self.soup.colors[*corner as usize]);
            }
        }
        let renumbered = self.soup.triangles.iter();
        left.triangles =
            renumbered.map(|corners| corners.map(|corner| numbers[corner as usize])).collect();
        left
    }
}
