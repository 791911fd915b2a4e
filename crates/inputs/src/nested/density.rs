//! Densities of a model at the nodes of a box.

use std::sync::Arc;

use super::cell::points;
use super::matter::Matter;
use super::world::World;
use crate::base::error::Result;
use crate::base::progress::{Progress, Silent};
use crate::lazy::Lazy;
use crate::model::field::{Activation, Lattice, NodeValues, Scene};
use crate::model::grid::{Nodes, row};
use crate::network::{PlaneCache, visit};

/// Approximate number of positions that are evaluated at once.
const AT_ONCE: usize = 512;
/// Optical depth between two nodes that is fully opaque.
const OPAQUE: f64 = 60.0;

/// Raw densities at the nodes of a box, plane by plane.
#[derive(Debug)]
pub struct SampledDensity<W> {
    world: Arc<W>,
    lattice: Lattice,
    /// The meaning of a raw density.
    raw: RawDensity,
    /// True if densities are 0 where the model takes no samples; else a mask marks that space.
    masked: bool,
    /// For a probed model: the nodes near matter, and their densities for the next pass.
    matter: Lazy<Matter>,
    planes: PlaneCache,
}

/// Optical depths per world unit as raw densities.
#[derive(Debug, Clone, Copy)]
struct RawDensity {
    activation: Activation,
    /// The activated density for an optical depth of 1 per world unit.
    per_unit: f64,
    /// Upper limit of optical depths per world unit.
    densest: f64,
}

impl RawDensity {
    fn of(self, density: f64) -> f32 {
        self.activation.stored_raw(density.min(self.densest) * self.per_unit)
    }
}

impl<W: World> SampledDensity<W> {
    /// For the nodes of `lattice`, as raw densities of a scene with this activation and these
    /// steps.
    pub fn new(world: Arc<W>, lattice: Lattice, scene: &Scene, masked: bool) -> Self {
        let activation = &scene.activation;
        let spacing = lattice.nodes.spacing(&lattice.bounds).into_iter().fold(0.0, f64::max);
        let raw = RawDensity {
            activation: *activation,
            per_unit: scene.march.interval_length() / f64::from(activation.interval),
            densest: OPAQUE / spacing,
        };
        let (matter, planes) = (Lazy::default(), PlaneCache::with_archive());
        Self { world, lattice, raw, masked, matter, planes }
    }

    fn matter(&self, progress: &dyn Progress) -> Result<Arc<Matter>> {
        let loaded = self.world.load()?;
        let find = || Matter::find(&*self.world, &loaded, &self.lattice, self.masked, progress);
        self.matter.get(find)
    }

    /// Fills in the nodes of a region.
    fn fill(&self, x: usize, region: &[u64], out: &mut [f32]) -> Result<()> {
        let loaded = self.world.load()?;
        let Nodes([_, _, nz]) = self.lattice.nodes;
        let (mut positions, mut densities) = (Vec::new(), Vec::new());
        // Places of nodes in the plane, and how many positions each has.
        let mut nodes: Vec<(usize, usize)> = Vec::new();
        let mut find = |positions: &mut Vec<[f64; 3]>, nodes: &mut Vec<(usize, usize)>| {
            densities.clear();
            self.world.densities(&loaded, positions, self.masked, &mut densities);
            let mut left = densities.as_slice();
            for (at, count) in nodes.drain(..) {
                let (own, rest) = left.split_at(count.min(left.len()));
                left = rest;
                if let Some(out) = out.get_mut(at) {
                    *out = self.raw.of(own.iter().sum::<f64>() / count as f64);
                }
            }
            positions.clear();
        };
        visit(self.lattice.nodes, region, |[y, z]| {
            let own = points(&*self.world, &self.lattice, [x, y, z], false);
            nodes.push((y * nz + z, own.len()));
            positions.extend(own);
            if positions.len() >= AT_ONCE {
                find(&mut positions, &mut nodes);
            }
        });
        find(&mut positions, &mut nodes);
        Ok(())
    }
}

impl<W: World> NodeValues for SampledDensity<W> {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        let own = match self.world.is_probed() {
            true => Matter::bytes(self.lattice.nodes) + self.planes.bytes(self.lattice.nodes, 1),
            false => 0,
        };
        self.world.memory_bytes() + own
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.world.digest(hash)
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        match self.world.is_probed() {
            true => self.matter(progress).map(drop),
            false => self.world.load().map(drop),
        }
    }

    fn read(&self, _: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        if !self.world.is_probed() {
            self.fill(x, region, out)?;
            return Ok(0);
        }
        // Before the plane is locked.
        let matter = self.matter(&Silent)?;
        let mut near = region.to_vec();
        row::and_into(&mut near, matter.plane(x));
        let (nodes, words) = (self.lattice.nodes, row::words(self.lattice.nodes));
        self.planes
            .read(nodes, x, [0, 1], &near, out, |missing, values| self.fill(x, missing, values))?;
        let Nodes([_, _, nz]) = nodes;
        for (near, out) in near.chunks_exact(words).zip(out.chunks_exact_mut(nz)) {
            for (start, end) in row::gaps(near, nz) {
                let empty = self.raw.activation.empty_raw();
                out.get_mut(start..end).unwrap_or_default().fill(empty);
            }
        }
        Ok(0)
    }
}
