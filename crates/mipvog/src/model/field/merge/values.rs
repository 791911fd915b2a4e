//! Values of merged fields at nodes, a plane at a time.

use std::sync::Arc;

use super::part::Part;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::field::{Activation, Grid, NodeValues};
use crate::model::grid::Nodes;

/// Minimum weight of a colour, as an optical depth, so that nodes without a visible field have a
/// colour too.
const LEAST_WEIGHT: f64 = 1e-300;

/// Fields on one grid.
#[derive(Debug)]
pub struct Merged {
    pub parts: Vec<Part>,
    /// The grid.
    pub nodes: Nodes,
    /// The meaning of merged densities.
    pub activation: Activation,
    /// Optical depth per world unit of a merged density of 1.
    pub depth_of_density: f64,
}

/// Raw density.
#[derive(Debug)]
pub struct MergedDensity(pub Arc<Merged>);

/// Colour and all its components.
#[derive(Debug)]
pub struct MergedColor {
    pub merged: Arc<Merged>,
    pub channels: usize,
}

/// The state of a node.
#[derive(Debug, Clone, Copy)]
struct Sum {
    /// True once a field that continues around the node counts.
    goes_on: bool,
    /// Optical depth.
    depth: f64,
    /// A number, weighted by optical depth.
    weighted: f64,
    /// The largest depth, and its raw density if that has the merged meaning.
    largest: f64,
    raw: Option<f32>,
}

impl Sum {
    /// No field yet.
    const NONE: Self = Self { goes_on: false, depth: 0.0, weighted: 0.0, largest: -1.0, raw: None };

    /// Adds a field's depth and number.
    fn add(&mut self, goes_on: bool, depth: f64, number: f64, raw: Option<f32>) {
        if !goes_on && (self.goes_on || depth <= self.largest) {
            return;
        }
        if !goes_on || !self.goes_on {
            *self = Self { goes_on, ..Self::NONE };
        }
        self.depth += depth;
        self.weighted += depth * number;
        if depth > self.largest {
            (self.largest, self.raw) = (depth, raw);
        }
    }
}

impl Merged {
    /// The raw density of an optical depth per world unit.
    fn raw(&self, depth: f64) -> f32 {
        self.activation.stored_raw(depth / self.depth_of_density)
    }

    /// For each node of the part, calls `add` with its index in plane `x`, its index in the part's
    /// values, and whether the part continues there.
    fn visit(&self, part: &Part, x: usize, mut add: impl FnMut(usize, usize, bool)) {
        let [_, ys, zs] = &part.spans;
        for (row, y) in ys.clone().enumerate() {
            for (column, z) in zs.clone().enumerate() {
                add(y * self.nodes.0[2] + z, row * zs.len() + column, part.goes_on([x, y, z]));
            }
        }
    }

    fn density_plane(&self, x: usize, out: &mut [f32]) -> Result<u64> {
        let mut sums: Vec<Option<Sum>> = vec![None; out.len()];
        let mut bytes = 0;
        for part in &self.parts {
            let Some(values) = part.densities(x)? else { continue };
            bytes += size_of_val(&*values) as u64;
            self.visit(part, x, |node, own, goes_on| {
                let raw = values[own];
                let sum = sums[node].get_or_insert(Sum::NONE);
                sum.add(goes_on, part.depth(raw), 0.0, part.is_alike.then_some(raw));
            });
        }
        for (value, sum) in out.iter_mut().zip(sums) {
            *value = match sum {
                None => self.activation.empty_raw(),
                // The others' shares are lost in rounding.
                Some(Sum { depth, largest, raw: Some(raw), .. }) if depth == largest => raw,
                Some(Sum { depth, .. }) => self.raw(depth),
            };
        }
        Ok(bytes)
    }

    fn color_plane(&self, channel: usize, x: usize, out: &mut [f32]) -> Result<u64> {
        out.fill(0.0);
        let here = |part: &Part| part.spans[0].contains(&x);
        let is_alone = |number: usize, part: &Part| {
            let mut others = self.parts.iter().enumerate().filter(|(other, _)| *other != number);
            !others.any(|(_, other)| here(other) && other.meets(part))
        };
        let mut sums: Vec<Sum> = Vec::new();
        let mut bytes = 0;
        for (number, part) in self.parts.iter().enumerate() {
            let Some(colors) = part.colors(channel, x)? else { continue };
            bytes += size_of_val(&*colors) as u64;
            if is_alone(number, part) {
                self.visit(part, x, |node, own, _| out[node] = colors[own]);
                continue;
            }
            let Some(densities) = part.densities(x)? else { continue };
            sums.resize(out.len(), Sum::NONE);
            self.visit(part, x, |node, own, goes_on| {
                let depth = part.depth(densities[own]).max(LEAST_WEIGHT);
                sums[node].add(goes_on, depth, f64::from(colors[own]), None);
            });
        }
        for (value, sum) in out.iter_mut().zip(sums).filter(|(_, sum)| sum.depth > 0.0) {
            *value = (sum.weighted / sum.depth) as f32;
        }
        Ok(bytes)
    }

    fn grids(&self) -> impl Iterator<Item = &Grid> {
        self.parts.iter().flat_map(|part| part.field().grids())
    }

    fn memory_bytes(&self) -> u64 {
        self.grids().map(Grid::memory_bytes).sum()
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.grids().try_for_each(|grid| grid.prepare(progress))
    }

    fn release(&self) {
        self.grids().for_each(Grid::release);
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        for grid in self.grids() {
            if let Grid::Values(values) = grid {
                values.digest(hash)?;
                continue;
            }
            let [nx, ny, nz] = grid.nodes().0;
            let mut plane = vec![0.0; ny * nz];
            for channel in 0..grid.channels() {
                for x in 0..nx {
                    grid.read_plane(channel, x, &mut plane, &mut *hash)?;
                }
            }
        }
        Ok(())
    }
}

impl NodeValues for MergedDensity {
    fn nodes(&self) -> Nodes {
        self.0.nodes
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.0.digest(hash)
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.0.prepare(progress)
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        self.0.density_plane(x, out)
    }

    fn release(&self) {
        self.0.release();
    }
}

impl NodeValues for MergedColor {
    fn nodes(&self) -> Nodes {
        self.merged.nodes
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn memory_bytes(&self) -> u64 {
        // The same fields as those of density, which counts them.
        0
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.merged.digest(hash)
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.merged.prepare(progress)
    }

    fn read(&self, channel: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        self.merged.color_plane(channel, x, out)
    }

    fn release(&self) {
        self.merged.release();
    }
}
