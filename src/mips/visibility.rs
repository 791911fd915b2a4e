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
/// Directions are summed in this many parts at once; fixed, so that sums are too.
const PARTS: usize = 4;

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
                _ => depths.iter_mut().for_each(|depth| *depth = self.matter.depth(*depth) as f32),
            }
            Ok(depths)
        })?;
        depths.iter().for_each(|plane| self.depths.extend_from_slice(plane));
        Ok(())
    }

    /// What can be seen past them.
    pub fn visibility(&self) -> Result<Visibility> {
        let directions = directions();
        let share = directions.len().div_ceil(PARTS);
        let parts = parallel::map(PARTS, |part| {
            let mut sums = vec![0.0; self.nodes.count()];
            for &direction in directions.iter().skip(part * share).take(share) {
                self.follow(direction, &mut sums);
            }
            Ok(sums)
        })?;
        let mut parts = parts.into_iter();
        let mut seen = parts.next().unwrap_or_default();
        for part in parts {
            seen.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        for seen in &mut seen {
            let mean = *seen / directions.len() as f32;
            *seen = mean * mean + LEAST_SEEN;
        }
        Ok(Visibility { nodes: self.nodes, seen })
    }

    /// Adds to each node the light that gets there along `direction`.
    fn follow(&self, direction: [isize; 3], sums: &mut [f32]) {
        let [nx, ny, nz] = self.nodes.0;
        let [dx, dy, dz] = direction;
        let squares = [0, 1, 2].map(|axis| (direction[axis] as f32 * self.spacing[axis]).powi(2));
        let length = (squares[0] + squares[1] + squares[2]).sqrt();
        // Light behind each node of the plane before and of this one.
        let mut before = vec![1.0; ny * nz];
        let mut behind = vec![1.0; ny * nz];
        let unhindered = vec![1.0; nz];
        let mut light = vec![1.0; nz];
        for x in 0..nx {
            let x = if dx < 0 { nx - 1 - x } else { x };
            std::mem::swap(&mut before, &mut behind);
            for y in 0..ny {
                let y = if dy < 0 { ny - 1 - y } else { y };
                let row = (x * ny + y) * nz..(x * ny + y + 1) * nz;
                let (depths, sums) = (&self.depths[row.clone()], &mut sums[row]);
                if [dx, dy] == [0, 0] {
                    along_row(depths, length, dz < 0, &mut light);
                    add(sums, &light);
                    continue;
                }
                let from = y.checked_add_signed(-dy).filter(|&from| from < ny);
                let planes = if dx == 0 { &behind } else { &before };
                let source = from.map_or(&unhindered[..], |from| &planes[from * nz..][..nz]);
                match dz {
                    0 => light.copy_from_slice(source),
                    1 => {
                        light[0] = 1.0;
                        light[1..].copy_from_slice(&source[..nz - 1]);
                    }
                    _ => {
                        light[nz - 1] = 1.0;
                        light[..nz - 1].copy_from_slice(&source[1..]);
                    }
                }
                add(sums, &light);
                weaken(&light, depths, length, &mut behind[y * nz..][..nz]);
            }
        }
    }
}

/// To a node's 26 neighbours.
fn directions() -> Vec<[isize; 3]> {
    let all = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]);
    all.filter(|&direction| direction != [0; 3]).collect()
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(values: &mut [f32], matter: &Matter) {
    let activation = &matter.activation;
    for value in values {
        let depth = lanes::softplus(*value + activation.shift) * activation.interval;
        *value = if depth > LEAST { depth } else { 0.0 };
    }
}

/// Light at each node of a row along z.
fn along_row(depths: &[f32], length: f32, backwards: bool, light: &mut [f32]) {
    let mut left = 1.0;
    for z in 0..depths.len() {
        let z = if backwards { depths.len() - 1 - z } else { z };
        light[z] = left;
        left = behind(left, depths[z] * length);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add(sums: &mut [f32], light: &[f32]) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum += light;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn weaken(light: &[f32], depths: &[f32], length: f32, behind: &mut [f32]) {
    for ((behind, light), depth) in behind.iter_mut().zip(light).zip(depths) {
        *behind = self::behind(*light, depth * length);
    }
}

/// What is left of `light` behind an optical depth.
#[inline(always)]
fn behind(light: f32, depth: f32) -> f32 {
    let left = light * lanes::exp(-depth.min(MOST_DEPTH));
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
    /// Multiplies `values` of plane `x` of a grid of `nodes` over the same box by what is seen there.
    pub fn weigh(&self, nodes: Nodes, x: usize, values: &mut [f32]) {
        let [_, ny, nz] = nodes.0;
        let [coarse_x, coarse_y, coarse_z] = self.nodes.0;
        let plane = |x: usize| &self.seen[x * coarse_y * coarse_z..][..coarse_y * coarse_z];
        let at = between(x, nodes.0[0], coarse_x);
        let across: Vec<f32> = mix(plane(at.low), plane(at.high), at.fraction).collect();
        let columns: Vec<Between> = (0..nz).map(|z| between(z, nz, coarse_z)).collect();
        let mut row = vec![0.0; coarse_z];
        for (y, values) in values.chunks_exact_mut(nz).enumerate() {
            let at = between(y, ny, coarse_y);
            let line = |y: usize| &across[y * coarse_z..][..coarse_z];
            let mixed = mix(line(at.low), line(at.high), at.fraction);
            row.iter_mut().zip(mixed).for_each(|(row, mixed)| *row = mixed);
            for (value, at) in values.iter_mut().zip(&columns) {
                *value *= row[at.low] + (row[at.high] - row[at.low]) * at.fraction;
            }
        }
    }
}
