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

use super::collapse_queue::{EdgeCollapse, Queue};
use super::quadric::Quadric;
use super::triangles::TriangleSoup;
use super::vector::{cross, dot, length, minus};

/// Weight of the distance to the vertex itself, relative to that to its planes.
const OWN_SHARE: f64 = 1e-3;
/// Triangles of a vertex up to which a search takes less time than sorting.
const FEW: usize = 32;
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

/// What a collapse reads of a vertex, side by side in memory: vertices are visited at random.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    /// From the surface's origin.
    position: [f64; 3],
    color: [f64; 3],
    quadric: Quadric,
    /// Area: the weight of the colour.
    weight: f64,
    changes: u32,
}

struct Surface {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
    /// Triangles of each vertex; empty once it was merged into another.
    around: Vec<Vec<u32>>,
    /// By triangle; false once it is gone.
    alive: Vec<bool>,
    count: usize,
    /// Squared.
    cell: f64,
    /// The first position, subtracted from all others for precision.
    origin: [f64; 3],
    /// Lowest and highest coordinates; merged vertices stay in this box.
    extent: [[f64; 3]; 2],
}

impl Surface {
    fn new(soup: TriangleSoup, cell: f64) -> Self {
        let TriangleSoup { positions, colors, triangles } = soup;
        let origin = positions.first().copied().unwrap_or_default();
        let vertex = |(position, color)| {
            let (position, quadric) = (minus(position, origin), Quadric::default());
            Vertex { position, color, quadric, weight: 0.0, changes: 0 }
        };
        let vertices: Vec<Vertex> = positions.into_iter().zip(colors).map(vertex).collect();
        let bound = |pick: fn(f64, f64) -> f64| {
            let join = |a: [f64; 3], b: &Vertex| std::array::from_fn(|i| pick(a[i], b.position[i]));
            vertices.iter().fold([0.0; 3], join)
        };
        let extent =
            [bound(|a, b| if b < a { b } else { a }), bound(|a, b| if b > a { b } else { a })];
        let mut surface = Self {
            around: (0..vertices.len()).map(|_| Vec::with_capacity(8)).collect(),
            alive: vec![true; triangles.len()],
            count: triangles.len(),
            cell: cell * cell,
            origin,
            extent,
            vertices,
            triangles,
        };
        for (number, corners) in surface.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|corner| surface.vertices[corner as usize].position);
            let normal = cross(minus(b, a), minus(c, a));
            let twice = length(normal);
            for &corner in corners {
                let corner = corner as usize;
                surface.around[corner].push(number as u32);
                if twice > 0.0 {
                    let area = twice / 6.0;
                    let plane = Quadric::plane(normal.map(|n| n / twice), a, area);
                    let vertex = &mut surface.vertices[corner];
                    let point = Quadric::point(vertex.position, OWN_SHARE * area);
                    vertex.quadric = vertex.quadric.plus(&plane).plus(&point);
                    vertex.weight += area;
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
        let mut queue = Queue::new();
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for vertex in 0..self.around.len() as u32 {
            self.neighbours(vertex, &mut near);
            for &other in near.iter().filter(|other| **other > vertex) {
                self.plan([vertex, other], &mut queue);
            }
        }
        while let Some(edge) = queue.pop() {
            let current = edge.pair.map(|vertex| self.vertices[vertex as usize].changes);
            if current != edge.changes {
                continue;
            }
            let (to, _) = self.merged(edge.pair);
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
                self.plan([kept.min(other), kept.max(other)], &mut queue);
            }
        }
    }

    /// The other corners of a vertex's triangles, each once, in the order of their numbers.
    /// `others` is cleared first: a new list per collapse would take a tenth of the time.
    fn neighbours(&self, vertex: u32, others: &mut Vec<u32>) {
        others.clear();
        let around = &self.around[vertex as usize];
        let corners = |&triangle: &u32| {
            let [a, b, c] = self.triangles[triangle as usize];
            if a == vertex {
                [b, c]
            } else if b == vertex {
                [c, a]
            } else {
                [a, b]
            }
        };
        // On a closed surface, a corner that is the first of two in one triangle is the last in
        // another: half of them need not be sorted.
        others.extend(around.iter().map(|triangle| corners(triangle)[0]));
        let firsts = others.len();
        for [_, last] in around.iter().map(corners) {
            if firsts > FEW || !others[..firsts].contains(&last) {
                others.push(last);
            }
        }
        others.sort_unstable();
        others.dedup();
    }

    /// The position of the merged vertex of two vertices, and the sum of their quadrics.
    fn merged(&self, pair: [u32; 2]) -> ([f64; 3], Quadric) {
        let [a, b] = pair.map(|vertex| &self.vertices[vertex as usize]);
        let quadric = a.quadric.plus(&b.quadric);
        let middle = || std::array::from_fn(|axis| 0.5 * (a.position[axis] + b.position[axis]));
        let to = quadric.least().unwrap_or_else(middle);
        let [lowest, highest] = self.extent;
        (std::array::from_fn(|axis| to[axis].clamp(lowest[axis], highest[axis])), quadric)
    }

    /// Puts the collapse of an edge into the queue.
    fn plan(&self, pair: [u32; 2], queue: &mut Queue) {
        let [a, b] = pair.map(|vertex| &self.vertices[vertex as usize]);
        let (to, quadric) = self.merged(pair);
        let error = quadric.at(to);
        let colors = minus(a.color, b.color);
        let sum = a.weight + b.weight;
        let mean = if sum > 0.0 { a.weight * b.weight / sum } else { 0.0 };
        let error = if error > 0.0 { error } else { 0.0 };
        let loss = error + self.cell * mean * dot(colors, colors);
        queue.push(loss, EdgeCollapse { pair, changes: [a.changes, b.changes] });
    }

    /// True if no triangle flips and the surface stays a manifold: the common neighbours of both
    /// ends are the third corners of the edge's two triangles.
    fn is_harmless(&self, [a, b]: [u32; 2], to: [f64; 3], [near, far]: [&mut Vec<u32>; 2]) -> bool {
        self.neighbours(a, near);
        self.neighbours(b, far);
        let common = near.iter().filter(|vertex| far.binary_search(vertex).is_ok()).count();
        let shared = self.around[a as usize].iter();
        let shared = shared.filter(|&&t| self.triangles[t as usize].contains(&b)).count();
        if common != 2 || shared != 2 {
            return false;
        }
        let own = [a, b].into_iter().flat_map(|vertex| &self.around[vertex as usize]);
        own.map(|&triangle| self.triangles[triangle as usize])
            .filter(|corners| !(corners.contains(&a) && corners.contains(&b)))
            .all(|corners| {
                let old = corners.map(|corner| self.vertices[corner as usize].position);
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
        let other = self.vertices[gone];
        self.vertices[gone].changes += 1;
        let own = &mut self.vertices[kept];
        let (wa, wb) = (own.weight, other.weight);
        if wa + wb > 0.0 {
            let [a, b] = [own.color, other.color];
            own.color = std::array::from_fn(|i| (wa * a[i] + wb * b[i]) / (wa + wb));
        }
        own.weight = wa + wb;
        own.quadric = own.quadric.plus(&other.quadric);
        own.position = to;
        own.changes += 1;
        for triangle in std::mem::take(&mut self.around[gone]) {
            let corners = &mut self.triangles[triangle as usize];
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
                Some(twin) => [triangle, twin].into_iter().for_each(|t| self.remove(t)),
                None => self.around[kept].push(triangle),
            }
        }
    }

    /// A triangle of a vertex with the same corners that faces the opposite direction.
    fn twin(&self, vertex: usize, [a, b, c]: [u32; 3]) -> Option<u32> {
        let turned = [[a, c, b], [c, b, a], [b, a, c]];
        let mut around = self.around[vertex].iter().copied();
        around.find(|&other| turned.contains(&self.triangles[other as usize]))
    }

    fn remove(&mut self, triangle: u32) {
        if std::mem::replace(&mut self.alive[triangle as usize], false) {
            self.count -= 1;
        }
        for corner in self.triangles[triangle as usize] {
            self.around[corner as usize].retain(|&other| other != triangle);
        }
    }

    /// The remaining surface, without merged vertices.
    fn finish(mut self) -> TriangleSoup {
        let mut alive = self.alive.iter();
        self.triangles.retain(|_| alive.next() == Some(&true));
        let mut numbers = vec![u32::MAX; self.vertices.len()];
        let mut left = TriangleSoup::default();
        for corner in self.triangles.as_flattened() {
            let number = &mut numbers[*corner as usize];
            if *number == u32::MAX {
                *number = left.positions.len() as u32;
                let Vertex { position, color, .. } = self.vertices[*corner as usize];
                left.positions.push(std::array::from_fn(|axis| position[axis] + self.origin[axis]));
                left.colors.push(color);
            }
        }
        let renumbered = self.triangles.iter();
        left.triangles =
            renumbered.map(|corners| corners.map(|corner| numbers[corner as usize])).collect();
        left
    }
}
