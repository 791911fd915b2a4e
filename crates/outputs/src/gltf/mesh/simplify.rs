//! Fewer triangles: edges collapse, those with the least loss first (Garland and Heckbert 1997).
//!
//! Exact order would need a queue, in which most entries are outdated when their turn comes, and
//! whose collapses are far from each other in memory. Instead, each pass computes the losses of all
//! edges and collapses the cheapest in the order of their vertices in space, but none at a vertex
//! that has moved in the same pass.
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

use super::incidence::Incidence;
use super::losses::Losses;
use super::quadric::Quadric;
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

/// What a collapse reads of a vertex, in two lines of a cache: vertices are visited at random.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Vertex {
    /// From the surface's origin.
    position: [f64; 3],
    quadric: Quadric,
    /// Area: the weight of the colour.
    weight: f64,
    color: [f32; 3],
}

struct Surface {
    vertices: Vec<Vertex>,
    /// By vertex, the pass that moved or merged it last.
    moved: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// Triangles of each vertex; none once it was merged into another.
    around: Incidence,
    /// By triangle; false once it is gone.
    alive: Vec<bool>,
    count: usize,
    /// Squared.
    cell: f64,
    /// The first position, subtracted from all others for precision.
    origin: [f64; 3],
    /// Lowest and highest coordinates; merged vertices stay in this box.
    extent: [[f64; 3]; 2],
    /// By vertex, the search that met it last.
    met: Vec<u32>,
    searches: u32,
}

impl Surface {
    fn new(soup: TriangleSoup, cell: f64) -> Self {
        let TriangleSoup { positions, colors, triangles } = soup.in_spatial_order();
        let origin = positions.first().copied().unwrap_or_default();
        let vertex = |(position, color): ([f64; 3], [f64; 3])| Vertex {
            position: minus(position, origin),
            quadric: Quadric::default(),
            weight: 0.0,
            color: color.map(|value| value as f32),
        };
        let vertices: Vec<Vertex> = positions.into_iter().zip(colors).map(vertex).collect();
        let bound = |pick: fn(f64, f64) -> f64| {
            let join = |a: [f64; 3], b: &Vertex| std::array::from_fn(|i| pick(a[i], b.position[i]));
            vertices.iter().fold([0.0; 3], join)
        };
        let extent =
            [bound(|a, b| if b < a { b } else { a }), bound(|a, b| if b > a { b } else { a })];
        let mut surface = Self {
            around: Incidence::new(vertices.len(), &triangles),
            alive: vec![true; triangles.len()],
            count: triangles.len(),
            cell: cell * cell,
            origin,
            extent,
            moved: vec![0; vertices.len()],
            met: vec![0; vertices.len()],
            searches: 0,
            vertices,
            triangles,
        };
        for corners in &surface.triangles {
            let [a, b, c] = corners.map(|corner| surface.vertices[corner as usize].position);
            let normal = cross(minus(b, a), minus(c, a));
            let twice = length(normal);
            if twice > 0.0 {
                let area = twice / 6.0;
                let plane = Quadric::plane(normal.map(|n| n / twice), a, area);
                for &corner in corners {
                    let vertex = &mut surface.vertices[corner as usize];
                    let point = Quadric::point(vertex.position, OWN_SHARE * area);
                    vertex.quadric = vertex.quadric.plus(&plane).plus(&point);
                    vertex.weight += area;
                }
            }
        }
        surface
    }

    /// Collapses edges until at most `max_triangles` are left, or no edge can.
    fn collapse(&mut self, max_triangles: usize, careful: bool) {
        let (mut refused, mut stalls) = (0, 0u32);
        while self.count > max_triangles {
            let before = self.count;
            // Each collapse removes two triangles, but many edges wait for the next pass. Where none
            // may collapse, twice as many are tried.
            let wanted = (before - max_triangles) << stalls.min(20);
            let refused_before = refused;
            refused = self.pass(max_triangles, [refused, wanted], careful);
            match self.count == before {
                true if refused == refused_before => break,
                true => stalls += 1,
                false => stalls = 0,
            }
        }
    }

    /// Collapses the `wanted` edges of least loss in their order in space, which memory follows;
    /// but none whose vertices have moved in this pass. Returns the number of edges that may not.
    fn pass(
        &mut self,
        max_triangles: usize,
        [refused, wanted]: [usize; 2],
        careful: bool,
    ) -> usize {
        let mut losses = Losses::default();
        let edges = |triangle: &[u32; 3]| {
            let [a, b, c] = *triangle;
            // Two triangles of a closed surface have an edge in opposite directions.
            [[a, b], [b, c], [c, a]].into_iter().filter(move |[a, b]| a < b || !careful)
        };
        let mut alive = self.alive.iter();
        let left: Vec<[u32; 3]> =
            self.triangles.iter().copied().filter(|_| alive.next() == Some(&true)).collect();
        for [a, b] in left.iter().flat_map(edges) {
            losses.add(self.loss([a.min(b), a.max(b)]));
        }
        let cheap = losses.cheapest(refused, refused + wanted);
        let mut refused = 0;
        self.searches += 1;
        let pass = self.searches;
        for ([a, b], _) in left.iter().flat_map(edges).zip(cheap).filter(|(_, cheap)| *cheap) {
            let pair = [a.min(b), a.max(b)];
            if pair.iter().any(|vertex| self.moved[*vertex as usize] == pass) {
                continue;
            }
            let stays = match careful {
                true => self.stays_manifold(pair),
                // Its triangles may have gone with those of others.
                false => self.around.of(a).iter().any(|t| self.triangles[*t as usize].contains(&b)),
            };
            if !stays {
                refused += usize::from(careful);
                continue;
            }
            let (to, quadric) = self.merged(pair);
            if careful && !self.keeps_facing(pair, to) {
                refused += 1;
                continue;
            }
            self.merge(pair, to, quadric);
            for vertex in pair {
                self.moved[vertex as usize] = pass;
            }
            if self.count <= max_triangles {
                break;
            }
        }
        refused
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

    /// The loss of the collapse of an edge.
    fn loss(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|vertex| &self.vertices[vertex as usize]);
        let (to, quadric) = self.merged(pair);
        let error = quadric.at(to);
        let colors = std::array::from_fn(|i| f64::from(a.color[i]) - f64::from(b.color[i]));
        let sum = a.weight + b.weight;
        let mean = if sum > 0.0 { a.weight * b.weight / sum } else { 0.0 };
        let error = if error > 0.0 { error } else { 0.0 };
        error + self.cell * mean * dot(colors, colors)
    }

    /// True if the surface stays a manifold: the common neighbours of both ends are the third
    /// corners of the edge's two triangles.
    fn stays_manifold(&mut self, [a, b]: [u32; 2]) -> bool {
        let [first, second] = [self.searches + 1, self.searches + 2];
        self.searches = second;
        let mut shared = 0;
        for &triangle in self.around.of(a) {
            let corners = self.triangles[triangle as usize];
            shared += usize::from(corners.contains(&b));
            for corner in corners {
                self.met[corner as usize] = first;
            }
        }
        for vertex in [a, b] {
            self.met[vertex as usize] = second;
        }
        let mut common = 0;
        for &triangle in self.around.of(b) {
            for corner in self.triangles[triangle as usize] {
                let met = &mut self.met[corner as usize];
                common += usize::from(*met == first);
                *met = second;
            }
        }
        common == 2 && shared == 2
    }

    /// True if no triangle flips when both vertices move `to` one place.
    fn keeps_facing(&self, [a, b]: [u32; 2], to: [f64; 3]) -> bool {
        let own = [a, b].into_iter().flat_map(|vertex| self.around.of(vertex));
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
                let cosine = dot(before, after);
                let lengths = dot(before, before) * dot(after, after);
                cosine > 0.0 && cosine * cosine > LEAST_TURN * LEAST_TURN * lengths
            })
    }

    fn merge(&mut self, pair: [u32; 2], to: [f64; 3], quadric: Quadric) {
        let [kept, gone] = pair;
        let other = self.vertices[gone as usize];
        let own = &mut self.vertices[kept as usize];
        let (wa, wb) = (own.weight, other.weight);
        if wa + wb > 0.0 {
            let [a, b] = [own.color, other.color].map(|color| color.map(f64::from));
            own.color = std::array::from_fn(|i| ((wa * a[i] + wb * b[i]) / (wa + wb)) as f32);
        }
        own.weight = wa + wb;
        own.quadric = quadric;
        own.position = to;
        let moved = self.around.take(gone);
        self.around.reserve(kept, moved.len());
        for at in moved {
            let triangle = self.around.at(at);
            let corners = &mut self.triangles[triangle as usize];
            if corners.contains(&kept) {
                self.remove(triangle);
                continue;
            }
            for corner in corners.iter_mut().filter(|corner| **corner == gone) {
                *corner = kept;
            }
            let corners = *corners;
            match self.twin(kept, corners) {
                // Both sides of an empty region.
                Some(twin) => [triangle, twin].into_iter().for_each(|t| self.remove(t)),
                None => self.around.push(kept, triangle),
            }
        }
    }

    /// A triangle of a vertex with the same corners that faces the opposite direction.
    fn twin(&self, vertex: u32, [a, b, c]: [u32; 3]) -> Option<u32> {
        let turned = [[a, c, b], [c, b, a], [b, a, c]];
        let mut around = self.around.of(vertex).iter().copied();
        around.find(|&other| turned.contains(&self.triangles[other as usize]))
    }

    fn remove(&mut self, triangle: u32) {
        if std::mem::replace(&mut self.alive[triangle as usize], false) {
            self.count -= 1;
        }
        for corner in self.triangles[triangle as usize] {
            self.around.remove(corner, triangle);
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
                left.colors.push(color.map(f64::from));
            }
        }
        let renumbered = self.triangles.iter();
        left.triangles =
            renumbered.map(|corners| corners.map(|corner| numbers[corner as usize])).collect();
        left
    }
}
