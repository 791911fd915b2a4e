//! Visibility: the share of each node that is visible from outside the box.
//!
//! The colour of coarser levels should be the colour that rays meet first. The inside of a wall,
//! which training never saw, and the back of a leaf must not mix into the front. So alpha weights
//! colour by how much light leaves the node:
//!
//! ```text
//! out(node, d)     = product over the nodes p behind `node` along d of exp(-depth(p) * length(d))
//! visibility(node) = (mean over the 26 directions d to a neighbour of out(node, d))^2 + 1e-4
//! ```
//!
//! with `depth` the optical depth of one interval and `length` the intervals from a node to the
//! next. The square favours nodes that are visible from most sides. The constant keeps the colour
//! of hidden nodes where there is no other.
//!
//! Light is traced on the finest level of at most 160 nodes per side, and visibility is
//! interpolated from there, so time and memory do not grow with the field. [`OpticalDepthGrid`]
//! collects that level's optical depths as it streams by.

use std::sync::{Mutex, PoisonError};

use multiversion::multiversion;

use super::AlphaDomain;
use super::importance::{NodeImportance, RECOVERY};
use super::transmittance::{BentNormals, NEGLIGIBLE, PlaneLight, TransmittanceSweep};
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::field::Activation;
use crate::model::grid::{NodeMask, Nodes, row};

/// Most nodes along the longest axis of the level on which light is traced.
const MAX_NODES: usize = 160;
/// The visibility of hidden nodes.
const LEAST_VISIBILITY: f32 = 1e-4;
/// Nodes above this visibility are lit: they get at least 1e-4 of the light of all directions.
const LIT: f32 = LEAST_VISIBILITY + 1e-8;

/// The optical depths that light passes through.
#[derive(Debug)]
pub struct OpticalDepthGrid {
    domain: AlphaDomain,
    level: usize,
    nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    spacing: [f32; 3],
    /// Optical depth over one interval by plane, z fastest; empty until taken.
    depths: Vec<Mutex<Vec<f32>>>,
    /// True if bent normals are found too.
    bent: bool,
    light: Light,
}

/// The light that visibility is measured with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Light {
    /// True if the importance of nodes to viewers nearby is found too.
    pub importance: bool,
    /// True if light also comes from empty space inside the box, so that the surroundings of a
    /// viewer inside are visible.
    pub from_inside: bool,
}

impl OpticalDepthGrid {
    /// For levels of `sizes` over a box whose edges are `extent` intervals long.
    pub fn new(domain: AlphaDomain, sizes: &[Nodes], extent: [f64; 3]) -> Self {
        let level = Self::level(sizes);
        let nodes = sizes[level];
        let spacing = [0, 1, 2].map(|axis| (extent[axis] / (nodes.0[axis] - 1) as f64) as f32);
        let depths = (0..nodes.0[0]).map(|_| Mutex::default()).collect();
        Self { domain, level, nodes, spacing, depths, bent: false, light: Light::default() }
    }

    /// Finds bent normals too, if `bent`.
    #[must_use]
    pub fn with_bent_normals(self, bent: bool) -> Self {
        Self { bent, ..self }
    }

    /// Sets the light.
    #[must_use]
    pub fn with_light(self, light: Light) -> Self {
        Self { light, ..self }
    }

    /// The level on which light is traced, among levels of `sizes`.
    pub fn level(sizes: &[Nodes]) -> usize {
        let small = |nodes: &Nodes| nodes.0.iter().all(|&size| size <= MAX_NODES);
        sizes.iter().position(small).unwrap_or(sizes.len() - 1)
    }

    /// Takes plane `x` of a level: raw densities of level 0, alphas of coarser levels. Other levels
    /// are ignored.
    pub fn take(&self, level: usize, x: usize, values: &[f32]) {
        if level != self.level {
            return;
        }
        let mut plane = values.to_vec();
        match level {
            0 => raw_optical_depths(&mut plane, &self.domain),
            _ => self.domain.optical_depths(values, &mut plane),
        }
        *lock(&self.depths[x]) = plane;
    }

    /// The visibility of all nodes, after every plane of the level was taken.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn visibility(self) -> Result<Visibility> {
        let Self { nodes, spacing, depths, bent, light, .. } = self;
        let depths = depths.into_iter().map(|plane| {
            let plane = plane.into_inner().unwrap_or_else(PoisonError::into_inner);
            if plane.is_empty() { vec![0.0; nodes.0[1] * nodes.0[2]] } else { plane }
        });
        let depths: Vec<Vec<f32>> = depths.collect();
        let recovery = if light.from_inside { RECOVERY } else { 0.0 };
        let sweep = TransmittanceSweep { nodes, spacing, depths: &depths, recovery };
        let importance = light.importance.then(|| NodeImportance::nearby(sweep)).transpose()?;
        let mut light = sweep.run(bent)?;
        parallel::map_mut(&mut light, |_, PlaneLight { sums, .. }| {
            for share in sums {
                let mean = *share / 26.0;
                *share = mean * mean + LEAST_VISIBILITY;
            }
            Ok(())
        })?;
        let (shares, bent) = light.into_iter().map(|plane| (plane.sums, plane.bent)).unzip();
        Ok(Visibility { nodes, shares, bent, importance })
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn raw_optical_depths(values: &mut [f32], domain: &AlphaDomain) {
    let Activation { shift, interval, function, .. } = domain.activation;
    for value in values {
        let depth = lanes::density(*value + shift, function) * interval;
        // As negligible as in the sweep.
        *value = if depth > NEGLIGIBLE { depth } else { 0.0 };
    }
}

/// The visible share of each node: from 1e-4, hidden, to 1.0001, alone.
#[derive(Debug)]
pub struct Visibility {
    nodes: Nodes,
    /// By plane, z fastest.
    shares: Vec<Vec<f32>>,
    /// By plane.
    bent: Vec<BentNormals>,
    /// Importance of the same nodes to viewers nearby, if requested.
    pub importance: Option<NodeImportance>,
}

/// The two nodes of a coarser axis around a node of a finer axis of the same length.
#[derive(Debug, Clone, Copy)]
pub struct LinearTap {
    /// The one before.
    pub low: usize,
    /// The one after; the same at the axis's end.
    pub high: usize,
    /// The position between them, 0 to below 1.
    pub fraction: f32,
}

/// Where node number `node` of `fine` ones lies among `coarse` ones.
pub fn linear_tap(node: usize, fine: usize, coarse: usize) -> LinearTap {
    let numerator = node * (coarse - 1);
    let low = numerator / (fine - 1);
    let fraction = (numerator % (fine - 1)) as f32 / (fine - 1) as f32;
    LinearTap { low, high: (low + 1).min(coarse - 1), fraction }
}

/// `low` and `high` mixed, by element.
fn mix(
    low: impl Iterator<Item = f32>,
    high: impl Iterator<Item = f32>,
    fraction: f32,
) -> impl Iterator<Item = f32> {
    low.zip(high).map(move |(low, high)| low + (high - low) * fraction)
}

impl Visibility {
    /// Visibility of plane `x` of a grid of `nodes` over the same box.
    pub fn sampler(&self, nodes: Nodes, x: usize) -> PlaneSampler {
        self.sampler_of(nodes, x, |x| self.shares[x].iter().copied())
    }

    /// Components of the bent normals along `axis` times 32767, at plane `x` of a grid of `nodes`
    /// over the same box. Requires bent normals.
    pub fn bent_sampler(&self, nodes: Nodes, x: usize, axis: usize) -> PlaneSampler {
        let part = |x: usize| self.bent[x][axis].iter().copied().map(f32::from);
        self.sampler_of(nodes, x, part)
    }

    /// The lit nodes of a grid over the same box.
    ///
    /// # Errors
    /// Too little memory.
    pub fn lit_nodes(&self, nodes: Nodes) -> Result<NodeMask> {
        let [_, ny, nz] = nodes.0;
        let words = row::words(nodes);
        NodeMask::of_planes(nodes, |x, plane| {
            let sampler = self.sampler(nodes, x);
            let (ones, mut shares) = (vec![1.0; nz], vec![0.0; nz]);
            for (y, row) in plane.chunks_exact_mut(words).enumerate().take(ny) {
                sampler.multiply(y * nz, &ones, &mut shares);
                row::pack_above(&shares, LIT, row);
            }
            Ok(())
        })
    }

    fn sampler_of<I: Iterator<Item = f32>>(
        &self,
        nodes: Nodes,
        x: usize,
        values: impl Fn(usize) -> I,
    ) -> PlaneSampler {
        let [nx, _, nz] = nodes.0;
        let [coarse_x, coarse_y, coarse_z] = self.nodes.0;
        let at = linear_tap(x, nx, coarse_x);
        let on_plane: Vec<f32> = mix(values(at.low), values(at.high), at.fraction).collect();
        if nz == coarse_z {
            return PlaneSampler { nodes, coarse_y, values: on_plane };
        }
        let columns: Vec<LinearTap> = (0..nz).map(|z| linear_tap(z, nz, coarse_z)).collect();
        let mut values = Vec::with_capacity(coarse_y * nz);
        for row in on_plane.chunks_exact(coarse_z) {
            let at = |at: &LinearTap| row[at.low] + (row[at.high] - row[at.low]) * at.fraction;
            values.extend(columns.iter().map(at));
        }
        PlaneSampler { nodes, coarse_y, values }
    }
}

/// Numbers of the nodes of one plane.
#[derive(Debug)]
pub struct PlaneSampler {
    nodes: Nodes,
    coarse_y: usize,
    /// At the coarser nodes along y, and at all nodes along z.
    values: Vec<f32>,
}

impl PlaneSampler {
    /// Multiplies `values`, all of one row, by the numbers of their nodes. The first value belongs
    /// to node `first` of the plane.
    pub fn multiply(&self, first: usize, values: &[f32], products: &mut [f32]) {
        let [_, ny, nz] = self.nodes.0;
        let (y, z) = (first / nz, first % nz);
        let at = linear_tap(y, ny, self.coarse_y);
        let row = |y: usize| &self.values[y * nz + z..][..values.len()];
        multiply_mixed(values, row(at.low), row(at.high), at.fraction, products);
    }
}

/// Multiplies `values` by a mix of `low` and `high`.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn multiply_mixed(values: &[f32], low: &[f32], high: &[f32], fraction: f32, products: &mut [f32]) {
    let mixed = low.iter().zip(high).map(|(low, high)| low + (high - low) * fraction);
    for ((product, value), by) in products.iter_mut().zip(values).zip(mixed) {
        *product = value * by;
    }
}
