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

use std::sync::{Mutex, PoisonError};

use multiversion::multiversion;

use super::Matter;
use super::light::{LEAST, Light};
use crate::base::error::Result;
use crate::model::activate::lanes;
use crate::model::grid::Nodes;

/// Nodes along the longest axis of the level on which light is followed, at most.
const MOST_NODES: usize = 160;
/// What hidden matter counts.
const LEAST_SEEN: f32 = 1e-4;

/// Matter that is in the way of light.
#[derive(Debug)]
pub struct Occluders {
    matter: Matter,
    level: usize,
    nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    spacing: [f32; 3],
    /// Optical depth over one interval, z fastest.
    depths: Mutex<Vec<f32>>,
}

impl Occluders {
    /// For levels of `sizes` over a box whose edges are `extent` intervals long.
    pub fn new(matter: Matter, sizes: &[Nodes], extent: [f64; 3]) -> Self {
        let level = Self::level(sizes);
        let nodes = sizes[level];
        let spacing = [0, 1, 2].map(|axis| (extent[axis] / (nodes.0[axis] - 1) as f64) as f32);
        Self { matter, level, nodes, spacing, depths: Mutex::new(vec![0.0; nodes.count()]) }
    }

    /// The level on which light is followed, of levels of `sizes`.
    pub fn level(sizes: &[Nodes]) -> usize {
        let small = |nodes: &Nodes| nodes.0.iter().all(|&size| size <= MOST_NODES);
        sizes.iter().position(small).unwrap_or(sizes.len() - 1)
    }

    /// Takes plane `x` of a level's raw densities (level 0) or amounts; other levels' are let by.
    pub fn take(&self, level: usize, x: usize, values: &[f32]) {
        if level != self.level {
            return;
        }
        let mut of_plane = values.to_vec();
        match level {
            0 => optical_depths(&mut of_plane, &self.matter),
            _ => self.matter.depths(values, &mut of_plane),
        }
        let mut depths = self.depths.lock().unwrap_or_else(PoisonError::into_inner);
        depths[x * values.len()..][..values.len()].copy_from_slice(&of_plane);
    }

    /// What can be seen past them.
    pub fn visibility(self) -> Result<Visibility> {
        let Self { nodes, spacing, depths, .. } = self;
        let depths = depths.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut seen = Light { nodes, spacing, depths: &depths }.sums()?;
        for seen in &mut seen {
            let mean = *seen / 26.0;
            *seen = mean * mean + LEAST_SEEN;
        }
        Ok(Visibility { nodes, seen })
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(values: &mut [f32], matter: &Matter) {
    let activation = &matter.activation;
    for value in values {
        let depth = lanes::softplus(*value + activation.shift) * activation.interval;
        // Less is none, as it is of light.
        *value = if depth > LEAST { depth } else { 0.0 };
    }
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
        let on_plane: Vec<f32> = mix(plane(at.low), plane(at.high), at.fraction).collect();
        let columns: Vec<Between> = (0..nz).map(|z| between(z, nz, coarse_z)).collect();
        let mut seen = Vec::with_capacity(coarse_y * nz);
        for row in on_plane.chunks_exact(coarse_z) {
            let at = |at: &Between| row[at.low] + (row[at.high] - row[at.low]) * at.fraction;
            seen.extend(columns.iter().map(at));
        }
        Weigher { nodes, coarse_y, seen }
    }
}

/// Weighs values of one plane by how much of their nodes is seen.
#[derive(Debug)]
pub struct Weigher {
    nodes: Nodes,
    coarse_y: usize,
    /// On the plane: at the coarser nodes along y, and at all along z.
    seen: Vec<f32>,
}

impl Weigher {
    /// Multiplies `values`, all of one row, of which node number `first` of the plane is the first.
    pub fn weigh(&self, first: usize, values: &[f32], weighted: &mut [f32]) {
        let [_, ny, nz] = self.nodes.0;
        let (y, z) = (first / nz, first % nz);
        let at = between(y, ny, self.coarse_y);
        let row = |y: usize| &self.seen[y * nz + z..][..values.len()];
        multiply(values, mix(row(at.low), row(at.high), at.fraction), weighted);
    }
}

fn multiply(values: &[f32], by: impl Iterator<Item = f32>, products: &mut [f32]) {
    for ((product, value), by) in products.iter_mut().zip(values).zip(by) {
        *product = value * by;
    }
}
