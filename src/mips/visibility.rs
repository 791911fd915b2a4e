//! How much of each node can be seen from outside the box.
//!
//! Colour of coarser levels is the colour of what rays meet first: the inside of a wall, which
//! training never saw, and the back of a leaf must not mix into what is in front. So matter counts
//! in colour by how much light gets out from it:
//!
//! ```text
//! out(node, d) = product over the nodes p behind `node` along d of exp(-depth(p) * length(d))
//! seen(node)   = (mean over the 26 directions d to a neighbour of out(node, d))^2 + 1e-4
//! ```
//!
//! with `depth` the optical depth of one interval and `length` the intervals from a node to the next.
//! The square favours what is seen from most sides; the remainder lets the colour of hidden matter
//! through where there is no other.
//!
//! Light is followed on the finest level that is at most 160 nodes long, and what is found is
//! interpolated, so that time and memory do not grow with the field. [`Occluders`] collects that
//! level's matter as it streams by.

use multiversion::multiversion;

use super::{Matter, Slab};
use crate::activate::lanes;
use crate::error::Result;
use crate::grid::Nodes;
use crate::parallel;

/// Nodes along the longest axis of the level on which light is followed, at most.
const MOST_NODES: usize = 160;
/// What hidden matter counts.
const LEAST_SEEN: f32 = 1e-4;
/// Light below this is none, and so is an optical depth; none is more than [`MOST_DEPTH`] from a node to
/// the next. All keep products from subnormal numbers, which processors are slow with.
const LEAST: f32 = 1e-9;
/// See [`LEAST`].
const MOST_DEPTH: f32 = 30.0;
/// Steps along each axis of the 26 directions, whatever their signs.
const STEPS: [[usize; 3]; 7] =
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]];

/// Matter that is in the way of light.
#[derive(Debug)]
pub struct Occluders {
    matter: Matter,
    level: usize,
    nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    spacing: [f32; 3],
    /// Optical depth over one interval, z fastest.
    depths: Vec<f32>,
}

impl Occluders {
    /// For levels of `sizes` over a box whose edges are `extent` intervals long.
    pub fn new(matter: Matter, sizes: &[Nodes], extent: [f64; 3]) -> Self {
        let level = Self::level(sizes);
        let nodes = sizes[level];
        let spacing = [0, 1, 2].map(|axis| (extent[axis] / (nodes.0[axis] - 1) as f64) as f32);
        Self { matter, level, nodes, spacing, depths: Vec::with_capacity(nodes.count()) }
    }

    /// The level on which light is followed, of levels of `sizes`.
    pub fn level(sizes: &[Nodes]) -> usize {
        let small = |nodes: &Nodes| nodes.0.iter().all(|&size| size <= MOST_NODES);
        sizes.iter().position(small).unwrap_or(sizes.len() - 1)
    }

    /// Takes the next slab of a level's raw densities (level 0) or amounts; other levels' are let by.
    pub fn take(&mut self, level: usize, slab: &Slab) -> Result<()> {
        if level != self.level {
            return Ok(());
        }
        let depths = parallel::map(slab.count(), |i| {
            let mut depths = slab.plane(i, 0).to_vec();
            match level {
                0 => optical_depths(&mut depths, &self.matter),
                _ => self.matter.depths(slab.plane(i, 0), &mut depths),
            }
            Ok(depths)
        })?;
        depths.iter().for_each(|plane| self.depths.extend_from_slice(plane));
        Ok(())
    }

    /// What can be seen past them.
    pub fn visibility(&self) -> Result<Visibility> {
        let mut seen = vec![0.0; self.nodes.count()];
        let mut passing = vec![0.0; self.nodes.count()];
        let plane = self.nodes.0[1] * self.nodes.0[2];
        for steps in STEPS {
            let squares = [0, 1, 2].map(|axis| (steps[axis] as f32 * self.spacing[axis]).powi(2));
            let length = (squares[0] + squares[1] + squares[2]).sqrt();
            let mut planes: Vec<_> =
                passing.chunks_mut(plane).zip(self.depths.chunks(plane)).collect();
            parallel::map_mut(&mut planes, |_, (passing, depths)| {
                transmittances(depths, length, passing);
                Ok(())
            })?;
            for direction in directions(steps) {
                self.follow(direction, &passing, &mut seen)?;
            }
        }
        for seen in &mut seen {
            let mean = *seen / 26.0;
            *seen = mean * mean + LEAST_SEEN;
        }
        Ok(Visibility { nodes: self.nodes, seen })
    }

    /// Adds to each node the light that gets there along `direction`, of which a node lets through what
    /// `passing` says.
    fn follow(&self, direction: [isize; 3], passing: &[f32], sums: &mut [f32]) -> Result<()> {
        let [nx, ny, nz] = self.nodes.0;
        let [dx, dy, dz] = direction;
        // Light goes from row to row; rows that it goes through one after the other are a line.
        let line_of = |x: usize, y: usize| match [dx, dy] {
            [0, 0] => x * ny + y,
            [0, _] => x,
            _ => (y as isize - dx * dy * x as isize + nx as isize) as usize,
        };
        let count = if [dx, dy] == [0, 0] { nx * ny } else { nx + ny + nx };
        let mut lines: Vec<Line> = (0..count).map(|_| Line::new()).collect();
        let rows = passing.chunks_exact(nz).zip(sums.chunks_exact_mut(nz));
        for (row, pair) in rows.enumerate() {
            lines[line_of(row / ny, row % ny)].push(pair);
        }
        let backwards = if dx == 0 { dy < 0 } else { dx < 0 };
        parallel::map_mut(&mut lines, |_, line| {
            if backwards {
                line.reverse();
            }
            match ([dx, dy], line.as_mut_slice()) {
                ([0, 0], [(passing, sums)]) => follow_row(dz < 0, passing, sums),
                (_, line) => follow_line(dz, line),
            }
            Ok(())
        })?;
        Ok(())
    }
}

/// Rows along z that light goes through one after the other: what their nodes let through, and the sums of
/// the light that gets there.
type Line<'a> = Vec<(&'a [f32], &'a mut [f32])>;

/// Follows light from row to row; along z it moves by `dz` nodes a row.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn follow_line(dz: isize, line: &mut [(&[f32], &mut [f32])]) {
    let nz = line.first().map_or(0, |(passing, _)| passing.len());
    let mut light = vec![1.0; nz];
    for (passing, sums) in line {
        match dz {
            1 => {
                light.copy_within(..nz - 1, 1);
                light[0] = 1.0;
            }
            -1 => {
                light.copy_within(1.., 0);
                light[nz - 1] = 1.0;
            }
            _ => {}
        }
        for ((light, sum), passing) in light.iter_mut().zip(sums.iter_mut()).zip(*passing) {
            *sum += *light;
            *light = behind(*light, *passing);
        }
    }
}

/// Follows light along z, through the nodes of one row.
fn follow_row(backwards: bool, passing: &[f32], sums: &mut [f32]) {
    let mut light = 1.0;
    for z in 0..passing.len() {
        let z = if backwards { passing.len() - 1 - z } else { z };
        sums[z] += light;
        light = behind(light, passing[z]);
    }
}

/// The directions to a node's 26 neighbours that are `steps` long along each axis.
fn directions(steps: [usize; 3]) -> impl Iterator<Item = [isize; 3]> {
    let all = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]);
    all.filter(move |direction: &[isize; 3]| direction.map(isize::unsigned_abs) == steps)
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(values: &mut [f32], matter: &Matter) {
    let activation = &matter.activation;
    for value in values {
        let depth = lanes::softplus(*value + activation.shift) * activation.interval;
        *value = if depth > LEAST { depth } else { 0.0 };
    }
}

/// What nodes let through to the next, `length` intervals away.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn transmittances(depths: &[f32], length: f32, passing: &mut [f32]) {
    for (passing, depth) in passing.iter_mut().zip(depths) {
        *passing = lanes::exp(-(depth * length).min(MOST_DEPTH));
    }
}

/// What is left of `light` behind what lets `passing` through.
#[inline(always)]
fn behind(light: f32, passing: f32) -> f32 {
    let left = light * passing;
    if left > LEAST { left } else { 0.0 }
}

/// How much of each node can be seen: from 1e-4, hidden, to 1.0001, alone.
#[derive(Debug)]
pub struct Visibility {
    nodes: Nodes,
    seen: Vec<f32>,
}

/// Where a node of a finer grid lies between two nodes of a coarser one that spans the same axis.
#[derive(Debug, Clone, Copy)]
struct Between {
    low: usize,
    high: usize,
    fraction: f32,
}

fn between(node: usize, fine: usize, coarse: usize) -> Between {
    let numerator = node * (coarse - 1);
    let low = numerator / (fine - 1);
    let fraction = (numerator % (fine - 1)) as f32 / (fine - 1) as f32;
    Between { low, high: (low + 1).min(coarse - 1), fraction }
}

/// `low` and `high` mixed, by element.
fn mix<'a>(low: &'a [f32], high: &'a [f32], fraction: f32) -> impl Iterator<Item = f32> + use<'a> {
    low.iter().zip(high).map(move |(low, high)| low + (high - low) * fraction)
}

impl Visibility {
    /// For plane `x` of a grid of `nodes` over the same box.
    pub fn weigher(&self, nodes: Nodes, x: usize) -> Weigher {
        let [nx, _, nz] = nodes.0;
        let [coarse_x, coarse_y, coarse_z] = self.nodes.0;
        let plane = |x: usize| &self.seen[x * coarse_y * coarse_z..][..coarse_y * coarse_z];
        let at = between(x, nx, coarse_x);
        Weigher {
            nodes,
            coarse: self.nodes,
            seen: mix(plane(at.low), plane(at.high), at.fraction).collect(),
            columns: (0..nz).map(|z| between(z, nz, coarse_z)).collect(),
        }
    }
}

/// Weighs values of one plane by how much of their nodes is seen.
#[derive(Debug)]
pub struct Weigher {
    nodes: Nodes,
    coarse: Nodes,
    /// On the plane, at the coarser nodes along y and z.
    seen: Vec<f32>,
    columns: Vec<Between>,
}

impl Weigher {
    /// Multiplies `values`, all of one row, of which node number `first` of the plane is the first.
    pub fn weigh(&self, first: usize, values: &[f32], weighted: &mut [f32]) {
        let [_, ny, nz] = self.nodes.0;
        let [_, coarse_y, coarse_z] = self.coarse.0;
        let (y, z) = (first / nz, first % nz);
        let columns = &self.columns[z..z + values.len()];
        let Some(low) = columns.first().map(|at| at.low) else { return };
        let high = columns.last().map_or(coarse_z, |at| at.high + 1);
        let at = between(y, ny, coarse_y);
        let line = |y: usize| &self.seen[y * coarse_z + low..y * coarse_z + high];
        let row: Vec<f32> = mix(line(at.low), line(at.high), at.fraction).collect();
        for ((weighted, value), at) in weighted.iter_mut().zip(values).zip(columns) {
            let [below, above] = [row[at.low - low], row[at.high - low]];
            *weighted = value * (below + (above - below) * at.fraction);
        }
    }
}
